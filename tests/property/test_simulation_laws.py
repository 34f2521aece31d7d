import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS

from pipeline.config.scenario import FlightPlan
from pipeline.geo.camera import Camera
from pipeline.simulation.bodies import body_mesh
from pipeline.simulation.flight import plan_flights
from pipeline.simulation.ground import Extent
from pipeline.simulation.mesh import ellipsoid, limb
from pipeline.simulation.models import MISSION_MODELS, random_train_model
from pipeline.simulation.people import Person
from pipeline.simulation.surface_model import utm_epsg

CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
lengths = st.floats(0.02, 3.0)


@given(st.floats(-80.0, 84.0), st.floats(-180.0, 180.0))
def test_a_position_lies_in_its_utm_zone(latitude, longitude):
    zone = CRS.from_epsg(utm_epsg(latitude, longitude)).utm_zone
    assert abs(longitude - (int(zone[:-1]) * 6.0 - 183.0)) <= 3.0 + 1e-9
    assert zone[-1] == ("N" if latitude >= 0.0 else "S")


@settings(max_examples=30, deadline=None)
@given(
    st.integers(1, 4),
    st.floats(20.0, 120.0),
    st.floats(20.0, 120.0),
    st.floats(5.0, 30.0),
    st.floats(1.0, 12.0),
    st.floats(-90.0, -25.0),
)
def test_every_flight_keeps_its_speed_and_its_height(drones, width, depth, spacing, speed, pitch):
    plan = FlightPlan.model_validate(
        {
            "drones": drones,
            "height": {"meters": 15},
            "speed": {"meters_per_second": speed},
            "pitch": {"degrees": pitch},
            "lane_spacing": {"meters": spacing},
            "longest": {"seconds": 40},
        }
    )
    flights = plan_flights(plan, CAMERA, Extent(width, depth), 10.0, lambda e, n: 0.0 * e + 7.0)
    assert len(flights) == drones
    for flight in flights:
        steps = np.linalg.norm(np.diff(flight.positions_enu, axis=0), axis=1)
        # the chord of an arc is shorter than the arc
        assert np.all(steps <= speed / 10.0 + 1e-9)
        assert np.all(steps >= 0.9 * min(speed / 10.0, spacing / 10.0))
        assert flight.positions_enu[:, 2] == pytest.approx(22.0)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_every_body_rests_on_its_footprint(seed):
    model = random_train_model(np.random.default_rng(seed))
    vertices = body_mesh(model).vertices
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    assert vertices[:, :2].min(axis=0) == pytest.approx(-vertices[:, :2].max(axis=0))
    assert np.ptp(vertices, axis=0).max() < 1.5 * model.height_m


@settings(deadline=None)
@given(st.floats(0.2, 3.0), st.floats(-4.0, 4.0), st.floats(0.0, 100.0))
def test_a_walker_comes_round_again(speed, heading, time_s):
    person = Person(0, MISSION_MODELS[0], 3.0, -2.0, heading, speed)
    round_s = 2.0 * math.pi * person.turn_radius_m / speed
    assert person.at(time_s + round_s)[:2] == pytest.approx(person.at(time_s)[:2], abs=1e-6)


def volume(mesh):
    """Of a closed mesh whose faces turn outwards: the divergence theorem."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return np.sum(a * np.cross(b, c)) / 6.0


@settings(deadline=None)
@given(lengths, lengths, lengths)
def test_an_ellipsoid_is_closed_and_faces_outwards(a, b, c):
    mesh = ellipsoid((5.0, -3.0, 2.0), (a, b, c), (0, 0, 0), sectors=40)
    assert volume(mesh) == pytest.approx(4.0 / 3.0 * math.pi * a * b * c, rel=0.03)


@settings(deadline=None)
@given(lengths, lengths)
def test_a_limb_is_a_capsule(length, radius):
    mesh = limb((1.0, 2.0, 3.0), (1.0, 2.0 + length, 3.0), radius, radius, (0, 0, 0), sectors=64)
    wanted = math.pi * radius**2 * (length + 4.0 / 3.0 * radius)
    assert volume(mesh) == pytest.approx(wanted, rel=0.08)
