"""Kinematics of the five-bar linkage: Eqs. 3 and 4 of the paper, inverse, limits, Jacobian."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import root
from support.refusals import refusal

from spots import SpotsError
from spots_linkage import Linkage
from spots_linkage.limits import Limit, LimitError
from spots_sim.person.mechanism import Mechanism, guided
from spots_sim.strip.files import (
    LinkageFile,
    PathFile,
    SensorFile,
    load,
)

NM = 1e-6  # in mm
UM = 1e-3
LINKAGES = [
    Linkage(100, 80),
    Linkage(100, 80, "near"),
    Linkage((90, 120, 105, 80), 70),
    Linkage((90, 120, 105, 80), 70, "near"),
    Linkage(40, 78),
    Linkage((60, 60, 100, 100), 150),
]
lengths = st.floats(20, 200)
linkages = st.tuples(st.tuples(*[lengths] * 4), lengths, st.sampled_from(["far", "near"]))


def made(arguments):
    bars, base, assembly = arguments
    assume(2 * max(*bars, base) < 0.98 * (sum(bars) + base))
    return Linkage(bars, base, assembly)


def grid(linkage, pitch_mm=1.7):
    reach = sum(linkage.bar_mm)
    axis = np.arange(-reach, reach + linkage.base_mm, pitch_mm)
    return np.meshgrid(axis, axis)


@pytest.mark.parametrize("linkage", LINKAGES, ids=repr)
def test_there_and_back_within_a_nanometre_over_the_workspace(linkage):
    x, y = grid(linkage)
    theta = linkage.inverse(x, y)
    assert theta[0].count() > 500
    assert np.ma.filled(abs(theta[0]), 0).max() <= np.pi
    back = linkage.forward(*theta)
    off = np.hypot(back[0] - x, back[1] - y)
    assert off.count() == theta[0].count()  # no point became masked
    assert off.max() < NM


def elbows_apart_mm(linkage, theta1, theta2):
    a1, _, _, a2 = linkage.bar_mm
    across = linkage.base_mm - a2 * np.sin(theta2) - a1 * np.sin(theta1)
    return np.ma.getdata(np.hypot(across, a2 * np.cos(theta2) - a1 * np.cos(theta1)))


@pytest.mark.board
@pytest.mark.parametrize("linkage", LINKAGES, ids=repr)
def test_there_and_back_within_a_micrometre_at_the_limits(linkage):
    # From points inside the limits, outwards until the next step exceeds a limit.
    x, y = grid(linkage, 11.0)
    fit = linkage.inverse_limits(x, y) == Limit.NONE
    x, y = x[fit], y[fit]
    found = [0, 0, 0]
    for way in np.linspace(0, 2 * np.pi, 16, endpoint=False):
        step = np.array([np.cos(way), np.sin(way)])
        low, high = np.zeros(len(x)), np.full(len(x), 1000.0)
        for _ in range(80):
            middle = (low + high) / 2
            ok = linkage.inverse_limits(x + middle * step[0], y + middle * step[1]) == 0
            low, high = np.where(ok, middle, low), np.where(ok, high, middle)
        for i, inside_mm in enumerate((0.0, 1e-6, 1e-3)):
            at = np.maximum(low - inside_mm, 0)
            px, py = x + at * step[0], y + at * step[1]
            theta = linkage.inverse(px, py)
            back = linkage.forward(*theta)
            off = np.hypot(back[0] - px, back[1] - py)
            if inside_mm < UM:
                # If the elbows meet, the angles do not determine the end point.
                off = off[elbows_apart_mm(linkage, *theta) > 1]
            assert off.count() == len(off)
            assert np.ma.filled(off, 0).max(initial=0) < (NM if inside_mm >= UM else UM)
            found[i] += len(off)
    assert min(found) > 50


@given(
    st.floats(20, 200), st.floats(10, 300), st.floats(-math.pi, math.pi), st.floats(0.001, 0.999)
)
def test_the_angles_are_those_of_the_papers_equations(bar, base, way, share):
    x, y = 2 * bar * share * math.cos(way), 2 * bar * share * math.sin(way)
    assume(math.hypot(base - x, y) < 1.999 * bar and base < 3.9 * bar)
    assume(math.hypot(base - x, y) > 0.01)
    # pi / 2 minus the direction; arctan(y / x) is the direction only to the right of the joint.
    first = math.pi / 2 - math.atan2(y, x) - math.acos(math.hypot(x, y) / (2 * bar))
    second = math.pi / 2 - math.atan2(y, base - x) - math.acos(math.hypot(base - x, y) / (2 * bar))
    near, far = Linkage(bar, base, "near"), Linkage(bar, base)
    fits = [one for one in (near, far) if one.inverse_limits(x, y) == Limit.NONE]
    assert fits  # one of the two assemblies reaches the point, in each quadrant
    for one in fits:
        theta = one.inverse(x, y)
        for told, paper in zip(theta, (first, second)):
            assert math.remainder(told - paper, 2 * math.pi) == pytest.approx(0, abs=1e-9)


@pytest.mark.board
@given(linkages, st.floats(-3, 3), st.floats(-3, 3), st.integers(0, 2**32 - 1))
def test_a_root_finder_that_knows_only_the_bars_agrees(arguments, theta1, theta2, seed):
    linkage = made(arguments)
    assume(linkage.forward_limits(theta1, theta2) == Limit.NONE)
    assume(linkage.outer_angle(theta1, theta2) > 0.05)
    a1, b1, b2, a2 = linkage.bar_mm
    elbow1 = a1 * np.array([math.sin(theta1), math.cos(theta1)])
    elbow2 = np.array([linkage.base_mm - a2 * math.sin(theta2), a2 * math.cos(theta2)])

    def off(terminal):
        return [
            np.hypot(*(terminal - elbow1)) / b1 - 1,
            np.hypot(*(terminal - elbow2)) / b2 - 1,
        ]

    # Both solutions, from starts on either side of the line of the elbows.
    across = np.array([elbow1[1] - elbow2[1], elbow2[0] - elbow1[0]])
    across /= np.hypot(*across)
    side = 1 if linkage.assembly == "far" else -1
    start = (elbow1 + elbow2) / 2 + side * across * max(b1, b2)
    solution = root(off, start, tol=1e-12)
    assume(solution.success and np.dot(solution.x - elbow1, across) * side > 0)
    assert np.hypot(*(np.array(linkage.forward(theta1, theta2)) - solution.x)) < 1e-5


def test_the_simulators_geometry_agrees():
    # The simulator intersects circles, and Eqs. 3 and 4 use arc cosines. They share no code.
    file, sensor = load(LinkageFile, "default"), load(SensorFile, "default")
    mechanism = Mechanism(file, sensor)
    linkage = Linkage(mechanism.bar_mm, mechanism.base_mm)
    motion = guided(load(PathFile, "sust"))
    theta = linkage.inverse(motion.x_mm, motion.y_mm)
    angles_deg = mechanism.angles_deg(motion.x_mm, motion.y_mm)
    for told, true, zero in zip(theta, angles_deg, mechanism.zero_rad):
        assert not np.ma.is_masked(told)
        assert abs(told - np.radians(true) - zero).max() < 1e-12


@pytest.mark.parametrize(
    ("place", "limit"),
    [
        ((250, 10), Limit.BEYOND_ARM_1),
        ((-190, 0), Limit.BEYOND_ARM_2),
        ((20, 30), Limit.WITHIN_ARM_1),
        ((70, 20), Limit.WITHIN_ARM_2),
        ((40, 75), Limit.OTHER_ASSEMBLY),
        ((math.nan, 3), Limit.NOT_FINITE),
        ((3, math.inf), Limit.NOT_FINITE),
    ],
)
def test_where_it_cannot_be_it_says_why(place, limit):
    bars = {Limit.WITHIN_ARM_1: (150, 90, 100, 80), Limit.WITHIN_ARM_2: (100, 80, 150, 90)}
    linkage = Linkage(bars.get(limit, 100), 80)
    with refusal(LimitError, limit=limit) as told:
        linkage.inverse(*place)
    assert told.value.limit == limit
    x, y = np.array([[40.0, place[0]], [150.0, place[1]]])
    theta1, theta2 = linkage.inverse(x, y)
    assert theta1.mask.tolist() == theta2.mask.tolist() == [False, True]
    assert linkage.inverse_limits(x, y).tolist() == [0, limit]
    assert np.isnan(theta1.data[1])  # without its mask, the value is NaN


def test_on_a_joint_the_angle_may_be_any():
    linkage = Linkage(100, 80)
    for place, limit in (((0, 0), Limit.AT_JOINT_1), ((80, 0), Limit.AT_JOINT_2)):
        assert linkage.inverse_limits(*place) == limit


@pytest.mark.parametrize(
    ("linkage", "theta", "limit"),
    [
        (Linkage((100, 45, 45, 100), 80), (-1.0, -1.0), Limit.ELBOWS_APART),
        (Linkage((100, 90, 20, 100), 80), (0.0, 0.2), Limit.ELBOWS_CLOSE),
        (Linkage(100, 80), (math.asin(0.4), math.asin(0.4)), Limit.ELBOWS_MEET),
        (Linkage(100, 80), (math.nan, 0.0), Limit.NOT_FINITE),
    ],
)
def test_angles_that_do_not_close_say_why(linkage, theta, limit):
    with refusal(LimitError, limit=limit):
        linkage.forward(*theta)
    x, y = linkage.forward([0.0, theta[0]], [0.0, theta[1]])
    assert x.mask.tolist() == y.mask.tolist() == [False, True]
    assert linkage.forward_limits([0.0, theta[0]], [0.0, theta[1]]).tolist() == [0, limit]


def test_in_line_the_jacobian_is_refused():
    linkage = Linkage(100, 80)
    # The elbows are 200 mm apart, at the same height.
    theta = -math.asin(0.6), -math.asin(0.6)
    assert linkage.forward(*theta) == pytest.approx((40, 80), abs=1e-4)
    with refusal(LimitError, limit=Limit.SINGULAR):
        linkage.jacobian(*theta)
    assert linkage.jacobian([theta[0], 0.0], [theta[1], -0.5]).mask.all(axis=(1, 2)).tolist() == [
        True,
        False,
    ]
    assert linkage.outer_angle(*theta) == pytest.approx(0, abs=1e-6)


@pytest.mark.board
@given(linkages, st.floats(-3, 3), st.floats(-3, 3))
def test_the_jacobian_is_the_slope(arguments, theta1, theta2):
    linkage = made(arguments)
    assume(linkage.forward_limits(theta1, theta2) == Limit.NONE)
    assume(linkage.outer_angle(theta1, theta2) > 0.1)
    step = 1e-6
    ahead = linkage.forward([theta1 + step, theta1], [theta2, theta2 + step])
    behind = linkage.forward([theta1 - step, theta1], [theta2, theta2 - step])
    slope = (np.array(ahead) - np.array(behind)) / (2 * step)
    jacobian = linkage.jacobian(theta1, theta2)
    assert jacobian == pytest.approx(slope, rel=1e-4, abs=1e-3)
    assert linkage.jacobian([theta1] * 3, [theta2] * 3)[1].data == pytest.approx(jacobian)


def test_the_covariance_is_that_of_a_scatter():
    linkage, rng = Linkage((90, 120, 105, 80), 70), np.random.default_rng(1)
    theta = linkage.inverse(30, 140)
    angles = np.array([[4e-6, 1.5e-6], [1.5e-6, 1e-6]])
    draws = rng.multivariate_normal(theta, angles, 200_000)
    scatter = np.cov(np.array(linkage.forward(*draws.T)))
    found = linkage.covariance(*theta, angles)
    assert found == pytest.approx(scatter, rel=0.03, abs=1e-5)
    many = linkage.covariance([theta[0], math.nan], [theta[1], 0.0], angles)
    assert many[0].data == pytest.approx(found)
    assert many.mask[1].all()


def test_shapes_broadcast_and_masks_stay():
    linkage = Linkage(100, 80)
    x, y = linkage.forward(np.zeros((3, 1)), [-0.6, -0.5])
    assert x.shape == y.shape == (3, 2)
    assert isinstance(x, np.ma.MaskedArray)
    x = np.ma.MaskedArray([40.0, 40.0], mask=[False, True])
    assert linkage.inverse(x, [150, 150])[0].mask.tolist() == [False, True]
    assert linkage.forward_limits(np.zeros((0,)), np.zeros((0,))).shape == (0,)
    assert isinstance(linkage.forward(0.0, -0.5)[0], float)


@pytest.mark.parametrize(
    ("bars", "base", "assembly", "words"),
    [
        (0, 80, "far", "positive"),
        (100, math.nan, "far", "positive"),
        ((1, 2, 3), 80, "far", "one bar length or four"),
        ("long", 80, "far", "one bar length or four"),
        (10, 80, "far", "below the sum"),
        (100, 80, "up", "'far' or 'near'"),
    ],
)
def test_an_invalid_linkage_is_refused(bars, base, assembly, words):
    with pytest.raises(SpotsError, match=words):
        Linkage(bars, base, assembly)
