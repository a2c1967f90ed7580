"""Looking over a data sheet: what has flown passes, and a slip of a unit is named."""

import numpy as np
import pytest

from baselines.studies.worlds import MINISAT, OBSERVATORY, POCKETQUBE
from satid_gym import SATELLITES, draw_satellites
from satid_gym.commands.main import main
from satid_gym.data_sheet import derived, doubts, left_out
from tests.cases import cases

MICROSAT = SATELLITES["microsat"]


def test_satellites_of_all_sizes_pass():
    """From 1e-3 to 1e4 kg m^2, and what random data sheets are like."""
    for satellite in (*SATELLITES.values(), POCKETQUBE, MINISAT, OBSERVATORY, *draw_satellites(range(7_000, 7_200))):
        assert doubts(satellite) == []


def off(**factors):
    """Microsat with values of its data sheet, and of its wheels, times factors."""
    sheet, wheels = {}, {}
    for name, factor in factors.items():
        if name.startswith("wheel_"):
            wheels[name[6:]] = factor * getattr(MICROSAT.wheels, name[6:])
        else:
            sheet[name] = factor * getattr(MICROSAT, name)
    return MICROSAT.replace(wheels=MICROSAT.wheels.replace(**wheels), **sheet)


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
    assert main(["check", "nosat"]) == 2
    assert "unknown satellite" in capsys.readouterr().err


@pytest.mark.parametrize("name", list(SATELLITES))
def test_nothing_is_printed_beyond_eighty_columns(name, capsys):
    main(["check", name])
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
