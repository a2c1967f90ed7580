"""Looking over a data sheet: what has flown passes, and a slip of a unit is named."""

import numpy as np
import pytest

from baselines.studies.worlds.satellites import MINISAT, OBSERVATORY, POCKETQUBE
from satid_gym import SATELLITES, Panel, SloshMass, StarTracker, draw_satellites, simulate
from satid_gym.commands.main import main
from satid_gym.data_sheet import derived, doubts, left_out
from satid_gym.files import write_json
from satid_gym.problem import problem
from tests.cases import cases

MICROSAT = SATELLITES["microsat"]
PANEL = Panel(hinge=[0.3, 0.0, 0.0], axis=[0.0, 0.0, 1.0], arm=[0.7, 0.0, 0.0], mass=1.0, frequency=0.3, damping=0.0)
TANK = SloshMass(position=[0.0, 0.4, 0.0], direction=[1.0, 0.0, 0.0], mass=4.0, frequency=0.2, damping=0.0)
TRACKER = StarTracker()


def test_satellites_of_all_sizes_pass():
    """From 1e-3 to 1e4 kg m^2, and what random data sheets are like."""
    for satellite in (*SATELLITES.values(), POCKETQUBE, MINISAT, OBSERVATORY, *draw_satellites(range(7_000, 7_200))):
        assert doubts(satellite) == []


@pytest.mark.parametrize("scenario", ["flex", "slosh"])
def test_satellites_of_the_scenarios_pass(scenario):
    found = problem("random", "static", scenario).satellites
    assert all(satellite.oscillators for satellite in found)
    assert [doubt for satellite in found for doubt in doubts(satellite)] == []


def off(**factors):
    """Microsat with values of its data sheet, and of its wheels, times factors."""
    sheet, wheels = {}, {}
    for name, factor in factors.items():
        if name.startswith("wheel_"):
            wheels[name[6:]] = factor * getattr(MICROSAT.wheels, name[6:])
        else:
            sheet[name] = factor * getattr(MICROSAT, name)
    return MICROSAT.replace(wheels=MICROSAT.wheels.replace(**wheels), **sheet)


def carrying(*oscillators):
    return MICROSAT.replace(oscillators=oscillators)


def tracking(tracker):
    return MICROSAT.replace(sensors={"star_tracker": tracker})


@cases(
    ("satellite", "words"),
    [
        (off(inertia=1e6), "moment about x, y, z is 8.25e+05 to 9.38e+05 times"),  # kg mm^2
        (off(inertia=1e4), "moment about"),  # kg cm^2
        (off(size=1e3), "the size in m"),
        (off(mass=1e3), "the mass in kg"),
        (off(rate_limit=180.0 / np.pi), "rate limit is 1.72 rad/s: is it in deg/s"),
        (off(wheel_max_torque=1e3), "torque in N m"),  # mN m
        (off(wheel_max_torque=1e-3), "torque in N m"),
        (off(wheel_max_speed=30.0 / np.pi), "speed limit of wheel 1, 2, 3 is 8.59e+03 rad/s: is it in rpm"),
        (off(wheel_inertia=1e-6), "rotor's inertia of wheel"),
        (off(gyro_noise_std=180.0 / np.pi), "noise of a sample"),
        (off(gyro_noise_std=0.0), "gyro_noise_std is 0"),
        (off(disturbance_std=1e3), "disturbance"),
        (MICROSAT.replace(tolerances={"gyro_bias": 0.5}), "tolerance of the gyro's bias"),
        (carrying(PANEL.replace(frequency=300.0)), "oscillator 1: the frequency is 300 Hz"),  # mHz
        (carrying(PANEL.replace(damping=0.5)), "damping is 0.5 of critical: is it in per cent?"),
        (carrying(PANEL.replace(deflection_limit=1.0)), "deflection limit is 1 rad: is it in deg?"),
        (carrying(TANK.replace(deflection_limit=5.0)), "deflection limit, 5 m, is more than its distance"),  # mm
        (carrying(PANEL.replace(arm=[30.0, 0.0, 0.0], mass=1e-3)), "are hinge and arm in m?"),
        (carrying(TANK, PANEL.replace(damping=0.5)), "oscillator 2"),
        (tracking(TRACKER.replace(across_std=5e-3, round_std=5e-3)), "across_std is 0.005 rad, 1.03e+03 arcsec"),
        (tracking(TRACKER.replace(round_std=0.0)), "round_std is 0 rad"),
        (tracking(TRACKER.replace(round_std=5e-6)), "are they exchanged?"),
        (tracking(TRACKER.replace(rate_limit=2.0)), "blind beyond 2 rad/s only: is that in deg/s?"),
        (tracking(TRACKER.replace(reacquire=5000.0)), "takes 5e+03 s to track again"),  # ms
    ],
)
def test_a_slip_of_a_unit_is_named(satellite, words):
    assert any(words in line for line in doubts(satellite)), doubts(satellite)


def test_what_follows_is_as_by_hand():
    own = derived(MICROSAT)
    np.testing.assert_allclose(own.to_limit, 0.03 * np.array([6.53, 5.96, 4.53]) / 0.1)
    np.testing.assert_allclose(own.reached, 2e-3 * 900.0 / np.array([6.53, 5.96, 4.53]))
    np.testing.assert_allclose(own.box[2], 4.53 / (95.0 / 12.0 * (0.5**2 + 0.6**2)))
    np.testing.assert_allclose(own.spin_up, 18.0)
    assert derived(MICROSAT.replace(mass=None)).box is None


@pytest.mark.parametrize(("oscillator", "axis"), [(PANEL, 2), (TANK, 2)])
def test_what_follows_from_a_panel_or_a_tank_is_what_it_does(oscillator, axis):
    """A step to full torque, flown: the largest deflection and the time between two rests."""
    body = carrying(oscillator).replace(mass=None)
    (mode,) = derived(body).modes
    torque = np.zeros((200, 3))
    torque[:, axis] = 0.1
    flown = simulate(body, torque, 0.02)
    deflection = np.abs(flown.deflection[:, 0])
    np.testing.assert_allclose(deflection.max(), mode.deflection, rtol=0.01)
    first = int(np.argmax(deflection[: int(1.0 / mode.free / 0.02)]))
    np.testing.assert_allclose(0.02 * first, 0.5 / mode.free, atol=0.02)
    assert mode.free > mode.held == oscillator.frequency
    assert np.flatnonzero(mode.share).tolist() == [axis]


def test_what_is_left_out_is_said_and_what_is_given_is_not():
    names = [line.partition(":")[0] for line in left_out(MICROSAT)]
    assert names[:2] == ["rate_limit", "gyro_noise_std"]
    assert names[-2:] == ["sensors.star_tracker", "oscillators"]
    given = MICROSAT.replace(rate_limit=0.031, tolerances={"gyro_bias": 1e-4}, sensors={"gyro_integrates": True})
    kept = [line.partition(":")[0] for line in left_out(given)]
    assert set(names) - set(kept) == {"rate_limit", "sensors"}
    (line,) = [line for line in left_out(given) if line.startswith("tolerances")]
    assert "gyro_bias" not in line
    assert "gyro_scale, gyro_alignment, wheel_inertia, wheel_alignment" in line
    counting = MICROSAT.replace(sensors={"encoder_pulses": 64}, tachometer_noise_std=0.0)
    assert doubts(counting) == []
    assert "tachometer_noise_std" not in "".join(left_out(MICROSAT.replace(sensors={"encoder_pulses": 64})))
    assert "mass: not given" in left_out(MICROSAT.replace(mass=None))


def test_what_is_left_out_of_panels_and_tracker_is_said():
    told = carrying(TANK, PANEL.replace(mass_std=0.1, deflection_limit=0.1)).replace(sensors={"star_tracker": TRACKER})
    lines = left_out(told)
    assert "oscillator 1: taken as exactly known: mass, frequency, damping" in lines
    assert "oscillator 1: any deflection is allowed" in lines
    assert [line for line in lines if "oscillator 2" in line] == [
        "oscillator 2: taken as exactly known: frequency, damping"
    ]
    assert "star tracker: never blind because of a high rate or the Sun or the Earth" in lines


def test_the_command(tmp_path, capsys):
    assert main(["check", "microsat"]) == 0
    assert "doubts: none" in capsys.readouterr().out
    (tmp_path / "sat.toml").write_text(
        'name = "mine"\ninertia = [6.5e6, 6.0e6, 4.5e6]\n[wheels]\ninertia = 2e-3\nmax_torque = 0.1\nmax_speed = 900\n'
    )
    assert main(["check", str(tmp_path / "sat.toml")]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "mass: not given" in said
    assert "is the inertia in kg m^2" in said
    bent = carrying(PANEL.replace(mass=0.3, mirrored=True, deflection_limit=0.02), TANK)
    write_json(tmp_path / "bent.json", bent.to_dict())
    assert main(["check", str(tmp_path / "bent.json")]) == 0
    table = capsys.readouterr().out
    assert "1, pair of panels" in table
    assert "2, slosh mass" in table
    assert main(["check", "nosat"]) == 2
    assert "unknown satellite" in capsys.readouterr().err


@pytest.mark.parametrize("name", list(SATELLITES))
def test_nothing_is_printed_beyond_eighty_columns(name, capsys):
    main(["check", name])
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
