"""The camera of a stream: from what the mission says, else from what the pictures' metadata say.

What was assumed is said, and goes into ``Camera.focal_sd``: the standard deviation of the focal length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.config.camera import CameraSource, EquivalentFocalLength, FieldOfView
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.geo.lens import fold_radius_px
from pipeline.ingest.cameras.calibration_file import read_calibration
from pipeline.ingest.cameras.known_cameras import KnownCamera, find_camera, known_cameras

#: diagonal and width of a picture on 35 mm film, millimetres
FILM_MM = {"diagonal": math.hypot(36.0, 24.0), "horizontal": 36.0}
#: what a field of view or a focal length of a specification sheet is worth: whole degrees, whole millimetres
#: (a judgement, not measured)
SPECIFIED_SD = 0.02
#: the same of a video whose share of the sensor is not known: 16:9 of the whole width or a crop of it
VIDEO_CROP_SD = 0.10
#: pictures this much wider than high are videos' 16:9: a sensor is 4:3 or 3:2
_VIDEO_ASPECT = 1.6
#: pictures of another shape than the stills show all of the sensor's width or height, or a few per cent less: 5.6 % of
#: a Mavic Air (3840 of 4056 columns, mavicpilots.com 85331), 3 % of a Mini 3 (75 degrees instead of 81.5,
#: forum.flylitchi.com 11483); what that leaves is worth is a judgement
_CROP, _CROP_SD = 1.03, 0.05
_SAME_SHAPE = 0.01
#: what rounding to whole pixels does to an aspect ratio
_SAME_ASPECT = 0.005
#: focal lengths over the width of the picture: of 150 degrees, and of 1 degree (zoom cameras reach 2000 mm equivalent)
_LEAST_FOCAL, _MOST_FOCAL = 0.134, 56.0
#: pixels that are not square (1.33 in some videos), and how far a sensor's middle may be from the picture's, as shares
_MOST_OBLONG, _FARTHEST_CENTER = 1.5, 0.3
WAYS_TO_SAY_IT = (
    "camera: FILE (a calibration), or camera: {field_of_view: {degrees: X, of: diagonal}} or "
    "{equivalent_focal_length: {millimeters: X}}"
)


@dataclass(frozen=True)
class PictureFacts:
    """What is known of a stream's pictures. width, height: pixels.

    names: of the camera or the drone in the metadata, the best first. calibration: in the metadata.
    focal_length_35mm: of the metadata, 0 if they have none. where: what an error names.
    """

    width: int
    height: int
    where: str
    names: tuple[str, ...] = ()
    calibration: Camera | None = None
    focal_length_35mm: float = 0.0


@dataclass(frozen=True)
class ChosenCamera:
    """focal_length_35mm: equivalent, that the camera belongs to; None: to the widest of the flight.

    assumed: what nobody said, a sentence each.
    """

    camera: Camera
    focal_length_35mm: float | None = None
    assumed: tuple[str, ...] = ()


def choose_camera(source: CameraSource, pictures: PictureFacts) -> ChosenCamera:
    """The camera of pictures. Raises InputError if there is none that can be used."""
    chosen = _chosen(source, pictures)
    if source.focal_length is not None:
        chosen = replace(chosen, focal_length_35mm=source.focal_length)
    require_plausible(chosen.camera, pictures.where)
    require_invertible(chosen.camera, pictures.where)
    return chosen


def require_plausible(camera: Camera, where: object) -> None:
    """Raises InputError for a camera that no drone has: a focal length in millimetres or shares, a centre elsewhere."""
    across = camera.fx / camera.width
    if not _LEAST_FOCAL <= across <= _MOST_FOCAL:
        degrees = 2.0 * math.degrees(math.atan(0.5 / across))
        found = (
            f"a focal length of {camera.fx:g} pixels for a picture {camera.width} wide: {degrees:.3g} degrees"
        )
        expected = "pixels, not millimetres or shares of the width"
        raise InputError(f"{where} camera focal length", found, expected)
    if not 1.0 / _MOST_OBLONG <= camera.fx / camera.fy <= _MOST_OBLONG:
        found = f"fx {camera.fx:g} and fy {camera.fy:g}"
        raise InputError(f"{where} camera focal length", found, "nearly the same in both directions")
    off = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    if off > _FARTHEST_CENTER:
        found = (
            f"a principal point at {camera.cx:g}, {camera.cy:g} of {camera.width} x {camera.height} pixels"
        )
        raise InputError(f"{where} camera principal point", found, "one near the middle of the picture")


def require_invertible(camera: Camera, where: object) -> None:
    """Raises InputError if the lens model folds inside of the picture."""
    size, center = (camera.width, camera.height), (camera.cx, camera.cy)
    radius_px = fold_radius_px(camera.distortion, (camera.fx, camera.fy), center, size)
    if radius_px is not None:
        corner_px = max(math.dist(center, (x, y)) for x in (0, camera.width) for y in (0, camera.height))
        raise InputError(
            f"{where} camera distortion",
            f"a lens model that folds {radius_px:.0f} pixels from the principal point "
            f"(the farthest corner is {corner_px:.0f} pixels away)",
            "coefficients that were fitted over the whole picture, or fewer of them",
        )


def fitted(camera: Camera, width: int, height: int, where: object) -> tuple[Camera, tuple[str, ...]]:
    """The camera for pictures of a size, scaled if they have its shape; and a sentence if it was scaled.

    Raises InputError if the shapes differ: what was cut off is not known.
    """
    if (camera.width, camera.height) == (width, height):
        return camera, ()
    across, down = width / camera.width, height / camera.height
    size = f"{camera.width} x {camera.height}"
    if abs(across / down - 1.0) > _SAME_ASPECT:
        raise InputError(
            f"{where} width, height", size, f"the size of the pictures, {width} x {height}, or its shape"
        )
    scaled = replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * across,
        fy=camera.fy * down,
        cx=camera.cx * across,
        cy=camera.cy * down,
    )
    return scaled, (f"{where}: made for {size}, scaled to {width} x {height} (the whole picture, not cut)",)


def _chosen(source: CameraSource, pictures: PictureFacts) -> ChosenCamera:
    if source.file is not None:
        return _from_file(source, pictures)
    if source.intrinsics is not None:
        where = f"{pictures.where} camera.intrinsics"
        camera, assumed = fitted(source.intrinsics.camera(), pictures.width, pictures.height, where)
        return ChosenCamera(camera, None, assumed)
    if source.field_of_view is not None:
        return ChosenCamera(_of_view(source.field_of_view, pictures, SPECIFIED_SD))
    if source.equivalent_focal_length is not None:
        return _equivalent(source.equivalent_focal_length, pictures)
    return _from_metadata(pictures)


def _from_file(source: CameraSource, pictures: PictureFacts) -> ChosenCamera:
    assert source.file is not None
    found = read_calibration(source.file)
    camera, assumed = found.camera, found.assumed
    if camera.width == 0:
        camera = replace(camera, width=pictures.width, height=pictures.height)
        off = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
        if off > 0.1:
            found_center = f"no size, and a principal point at {camera.cx:.0f}, {camera.cy:.0f}"
            raise InputError(source.file, found_center, "image_width and image_height")
        assumed = (
            *assumed,
            f"{source.file}: made for pictures of {camera.width} x {camera.height}; it does not say so",
        )
    camera, scaled = fitted(camera, pictures.width, pictures.height, source.file)
    return ChosenCamera(camera, None, (*assumed, *scaled))


def _of_view(view: FieldOfView, pictures: PictureFacts, sd: float) -> Camera:
    extents = {
        "horizontal": float(pictures.width),
        "vertical": float(pictures.height),
        "diagonal": math.hypot(pictures.width, pictures.height),
    }
    return _plain(pictures, extents[view.of] / 2.0 / math.tan(math.radians(view.degrees) / 2.0), sd)


def _equivalent(focal: EquivalentFocalLength, pictures: PictureFacts) -> ChosenCamera:
    extent = math.hypot(pictures.width, pictures.height) if focal.of == "diagonal" else float(pictures.width)
    focal_px = focal.millimeters / FILM_MM[focal.of] * extent
    is_video = focal.of == "diagonal" and pictures.width > _VIDEO_ASPECT * pictures.height
    sd = VIDEO_CROP_SD if is_video else SPECIFIED_SD
    how = "diagonal (CIPA DCG-001)" if focal.of == "diagonal" else "width"
    said = (
        f"{pictures.where}: {focal.millimeters:g} mm are {focal_px:.0f} pixels by the {how}, good to {sd:.0%}"
    )
    if is_video:
        said += "; a video shows a part of the sensor that the focal length does not tell"
    return ChosenCamera(_plain(pictures, focal_px, sd), focal.millimeters, (said,))


def _plain(pictures: PictureFacts, focal_px: float, sd: float) -> Camera:
    width, height = pictures.width, pictures.height
    return Camera(width, height, focal_px, focal_px, width / 2.0, height / 2.0, np.zeros(5), sd)


def _from_metadata(pictures: PictureFacts) -> ChosenCamera:
    focal_mm = pictures.focal_length_35mm
    if pictures.calibration is not None:
        camera, scaled = fitted(pictures.calibration, pictures.width, pictures.height, pictures.where)
        said = f"{pictures.where}: camera as its metadata say, good to {camera.focal_sd:.1%}"
        return ChosenCamera(camera, focal_mm or None, (said, *scaled))
    size = pictures.width, pictures.height
    known = find_camera(pictures.names, size, focal_mm, pictures.where, WAYS_TO_SAY_IT)
    if known is not None:
        return _known(known, pictures)
    if focal_mm > 0.0:
        return _equivalent(EquivalentFocalLength(millimeters=focal_mm), pictures)
    named = ""
    if pictures.names:
        named = f", of a camera called {pictures.names[0][:60]!r}, not one of the {len(known_cameras())} that are known"
    raise InputError(f"{pictures.where} camera", f"no focal length in the metadata{named}", WAYS_TO_SAY_IT)


def _known(known: KnownCamera, pictures: PictureFacts) -> ChosenCamera:
    """A camera of the list, for whole pictures or a part. Raises InputError for a focal length below its least."""
    focal_mm = pictures.focal_length_35mm
    if focal_mm and not known.is_widest(focal_mm) and focal_mm < known.equivalent:
        found = (
            f"a focal length of {focal_mm:g} mm, of a {known.camera}, whose least is {known.equivalent:g} mm"
        )
        raise InputError(f"{pictures.where} camera", found, WAYS_TO_SAY_IT)
    width, height = known.stills
    if (pictures.width < pictures.height) != (width < height):
        width, height = height, width  # the camera, or its pictures, stand upright
    across, down = pictures.width / width, pictures.height / height
    focal_px = known.focal_over_width * known.stills[0] * max(across, down)
    sd, part = known.focal_sd, ""
    if abs(across / down - 1.0) > _SAME_SHAPE and not known.only:
        focal_px, sd = _CROP * focal_px, math.hypot(known.focal_sd, known.video_sd or _CROP_SD)
        part = f"; not of the shape of its stills, so {_CROP - 1.0:.0%} less than the whole sensor"
    said = (
        f"{pictures.where}: the camera is a {known.camera}, known by its name: {focal_px:.0f} pixels, good to {sd:.1%}"
        f"{part}; source: {known.source}"
    )
    belongs_mm = focal_mm if focal_mm and known.is_widest(focal_mm) else known.equivalent
    return ChosenCamera(_plain(pictures, focal_px, sd), belongs_mm, (said,))
