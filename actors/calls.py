"""Calls to Ray's actors: where they are put, how long an answer is waited for, and what a failure is called."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from actors.site import placement
from pipeline.errors import RunFailedError, SearchlightError, in_one_line
from pipeline.logs import Log

_LOG = Log("actors")


class NoAnswerError(RunFailedError):
    """An actor did not answer in time."""


class UnreachableError(RunFailedError):
    """The way to an actor broke; it may go on behind it."""


def remote(actor: type, site: str | None) -> Any:
    """The class of an actor at a site, or anywhere."""
    import ray

    resources: Mapping[str, float] = {} if site is None else placement(site)
    return ray.remote(actor).options(num_cpus=0, resources=dict(resources))


def remote_here(actor: type) -> Any:
    """On the driver's own node: what the actor writes to the disk is on this machine."""
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    return ray.remote(actor).options(num_cpus=0, scheduling_strategy=here)


def get(what: Any, who: str, timeout_s: float | None = None) -> Any:
    """An actor's answer. Raises its own error if that is ours, else one that names who it was."""
    import ray

    try:
        return ray.get(what, timeout=timeout_s)
    except ray.exceptions.GetTimeoutError:
        raise NoAnswerError(f"{who} did not answer within {timeout_s:g} s") from None
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, SearchlightError):
            raise error.cause from None
        raise RunFailedError(f"{who} failed: {error}") from None
    except ray.exceptions.ActorUnavailableError as error:
        _LOG.warning("an actor is out of reach", who=who, error=str(error))
        raise UnreachableError(f"{who} is out of reach") from None
    except ray.exceptions.RayActorError as error:
        _LOG.warning("an actor died", who=who, error=str(error))
        raise RunFailedError(f"{who} died") from None
    except ray.exceptions.RayError as error:
        raise RunFailedError(f"{who}: {type(error).__name__}: {error}") from None


def named(error: SearchlightError, who: str) -> SearchlightError:
    """An error that an actor reports of itself; a failure says whose it was."""
    if type(error) is not RunFailedError:
        return error
    failed = RunFailedError(f"{who} failed: {in_one_line(error)}")
    failed.details = str(error)
    return failed


def kill(actor: Any) -> None:
    """End an actor's process, if it has not ended."""
    import ray

    with suppress(Exception):  # whatever is wrong with an actor, it is not to hold up the end
        ray.kill(actor)
