"""The data sets of an evaluation, read and checked."""

from __future__ import annotations

import json

from pipeline.config.evaluation import DataSetFile, Evaluation
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco import CocoOptions, dataset_of, read_coco
from pipeline.evaluation.datasets.coco_format import parsed
from pipeline.evaluation.datasets.converters import converted
from pipeline.evaluation.datasets.dataset import DataSet, joined, sha256_of_texts
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.datasets.groups import in_sequences
from pipeline.evaluation.datasets.mission_truth import read_mission


def read_datasets(evaluation: Evaluation, faults: FaultLog) -> DataSet:
    """All data sets as one. Raises InputError for what cannot be used, and if nobody is to be found."""
    dataset = joined(_read(d, evaluation, faults) for d in evaluation.datasets)
    if not (~dataset.truth.crowd).any():
        raise InputError(evaluation.datasets[0].path, "no visible person", "pictures with people to find")
    return dataset


def _read(source: DataSetFile, evaluation: Evaluation, faults: FaultLog) -> DataSet:
    path = source.path
    root = source.root or (path if source.format in ("mot", "visdrone") else path.parent)
    options = CocoOptions(
        root, evaluation.categories, evaluation.visible_min, source.frame_rate, source.is_simulated
    )
    if source.format == "mission":
        return read_mission(path, options, faults)
    if source.sequences is not None:
        document = in_sequences(parsed(path), source.sequences, path)
        return dataset_of(document, path, options, faults, sha256_of_texts([json.dumps(document)]))
    if source.format == "coco":
        return read_coco(path, options, faults)
    document = converted(source.format, path, faults)
    return dataset_of(document, path, options, faults, sha256_of_texts([json.dumps(document)]))
