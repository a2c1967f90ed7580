"""Learned policies: the network against torch, and files that are whole or refused."""

import json
from itertools import pairwise

import numpy as np
import onnx
import pytest
import torch

from agents.training.graph.export import TOLERANCE, export, graph, largest_difference, posed, recorded, session_of
from agents.training.ppo import PPOSettings
from agents.training.select import ratios
from satid_gym import SATELLITES
from satid_gym.control.rate_loop import RateLoop
from satid_gym.evaluation import fly, seeds
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.learned.shipped import find, shipped
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.satellite import BENCHMARK_SATELLITES
from tests.cases import cases

SIZE = 37
WHOLE = 70  # with the filter's whole covariance


def network(seed: int = 0, outputs: int = 3, scale: float = 0.3, inputs: int = SIZE, **choices) -> Network:
    rng = np.random.default_rng(seed)
    sizes = [inputs, 16, 8, outputs]
    weights = tuple((scale * rng.standard_normal((b, a))).astype(np.float32) for a, b in pairwise(sizes))
    return Network(weights, tuple(rng.standard_normal(b).astype(np.float32) for b in sizes[1:]), **choices)


def torch_network(network: Network) -> torch.nn.Sequential:
    """The same layers in torch, in double precision, and the cut to [-1, 1]."""
    layers: list[torch.nn.Module] = []
    for weight, bias in zip(network.weights, network.biases, strict=True):
        layer = torch.nn.Linear(weight.shape[1], weight.shape[0])
        layer.weight.data, layer.bias.data = torch.from_numpy(weight), torch.from_numpy(bias)
        layers += [layer.double(), torch.nn.Tanh() if network.activation == "tanh" else torch.nn.ReLU()]
    last = [torch.nn.Tanh()] if network.squashed else []
    return torch.nn.Sequential(*layers[:-1], *last, torch.nn.Hardtanh())


@pytest.mark.parametrize("choices", [{}, {"activation": "relu"}, {"activation": "relu", "squashed": True}])
def test_the_network_is_the_one_torch_computes(choices):
    net = network(**choices)
    observations = np.random.default_rng(1).uniform(-10, 10, (50, SIZE)).astype(np.float32)
    with torch.no_grad():
        expected = torch_network(net)(torch.from_numpy(observations).double()).numpy()
    np.testing.assert_allclose(np.clip(net(observations), -1, 1), expected, atol=1e-12)


@pytest.mark.parametrize("choices", [{}, {"activation": "relu", "squashed": True}])
def test_a_saved_policy_acts_the_same(tmp_path, choices):
    policy = LearnedPolicy("one", network(**choices), "rate", 2.4, details={"note": "kept"})
    policy.save(tmp_path / "one")
    again = find(str(tmp_path / "one"))
    observation = np.random.default_rng(2).uniform(-1, 1, (4, SIZE)).astype(np.float32)
    np.testing.assert_array_equal(again.network(observation), policy.network(observation))
    assert (again.name, again.control, again.margin, again.details) == ("one", "rate", 2.4, {"note": "kept"})
    assert again.include_covariance is False
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.json", "one.safetensors"]


def test_rate_commands_go_through_the_rate_loop():
    (mission,) = missions(problem("microsat"))
    policy = LearnedPolicy("rate", network(), "rate", 2.0)
    policy.reset(mission, [0])
    observation = np.random.default_rng(3).uniform(-0.5, 0.5, (6, SIZE)).astype(np.float32)
    expected = RateLoop([mission], 2.0)(observation, policy.network(observation))
    np.testing.assert_array_equal(policy(observation), expected)


def test_torque_is_passed_on_and_cut():
    (mission,) = missions(problem("microsat"))
    policy = LearnedPolicy("torque", network(scale=3.0), "torque", 0.0)
    policy.reset(mission, [0])
    observation = np.random.default_rng(4).uniform(-1, 1, (6, SIZE)).astype(np.float32)
    np.testing.assert_array_equal(policy(observation), np.clip(policy.network(observation), -1, 1))


def test_a_decision_before_reset_and_no_text_are_refused():
    with pytest.raises(RuntimeError, match=r"policy generalist .*call reset\(mission, seeds\)"):
        find("generalist")(np.zeros((1, WHOLE)))
    with pytest.raises(ValueError, match="policy must be the name or the path of a learned policy, got None"):
        find(None)


def test_it_flies_an_episode():
    flight = fly(LearnedPolicy("any", network(), "rate", 2.4), satellite="cubesat", inertia="static", seeds=[1, 2])
    assert flight.error.shape == (300, 2)


def test_it_flies_with_the_covariance():
    """As the same network without, where the weights of what it sees more of are 0; and not so where they are not."""
    cell = {"satellite": "cubesat", "inertia": "static", "seeds": [1, 2], "scenario": {"horizon": 20.0}}
    first, *others = network().weights
    errors = []
    for more in (0.0, 1.0):
        wide = np.hstack([first, np.full((len(first), WHOLE - SIZE), more, np.float32)])
        policy = LearnedPolicy("wide", Network((wide, *others), network().biases), "rate", 2.4, include_covariance=True)
        errors.append(fly(policy, **cell).error)
    narrow = fly(LearnedPolicy("narrow", network(), "rate", 2.4), **cell).error
    np.testing.assert_allclose(errors[0], narrow, rtol=1e-5)
    assert not np.allclose(errors[1], narrow, rtol=1e-2)


def test_files_keep_what_is_observed(tmp_path):
    policy = LearnedPolicy("x", network(inputs=WHOLE + 1), "rate", 2.4, include_covariance=True, include_walk=True)
    policy.save(tmp_path / "x")
    assert find(str(tmp_path / "x")).include_covariance is True
    assert find(str(tmp_path / "x")).include_walk is True
    head = json.loads((tmp_path / "x.json").read_text())
    assert head.pop("include_covariance") is True
    assert head.pop("include_walk") is True
    (tmp_path / "x.json").write_text(json.dumps(head))  # as files of before it was asked
    again = find(str(tmp_path / "x"))
    assert again.include_covariance is False
    assert again.include_walk is False
    assert again.details == {}


def test_it_observes_in_the_body_frame_and_its_file_says_so(tmp_path):
    policy = LearnedPolicy("x", network(inputs=40), "torque", 0.0, observation="body")
    policy.save(tmp_path / "x")
    again = find(str(tmp_path / "x"))
    assert again.observation == "body"
    cell = {"satellite": "cubesat", "inertia": "static", "seeds": [1], "scenario": {"horizon": 5.0}}
    np.testing.assert_array_equal(fly(again, **cell).error, fly(policy, **cell).error)
    (mission,) = missions(problem())
    with pytest.raises(ValueError, match='x observes "body", this environment gives "wheels"'):
        again.reset(mission, [0])
    rates = LearnedPolicy("x", network(inputs=40), "rate", 2.4, observation="body")
    with pytest.raises(ValueError, match="need the speed of each wheel"):
        rates.reset(missions(problem(observation="body"))[0], [0])
    assert np.isfinite(fly(rates, **cell, control="rate").error).all()
    with pytest.raises(ValueError, match="unknown observation of a learned policy 'wheel'"):
        LearnedPolicy("x", network(), "rate", 2.4, observation="wheel")


@cases("flag", [1, "yes", None, {"note": "where the details were once"}])
def test_what_is_no_flag_is_refused(tmp_path, flag):
    message = "include_covariance of a learned policy must be True or False"
    with pytest.raises(ValueError, match=message):
        LearnedPolicy("x", network(), "rate", 2.4, flag)
    LearnedPolicy("x", network(), "rate", 2.4).save(tmp_path / "x")
    head = json.loads((tmp_path / "x.json").read_text())
    (tmp_path / "x.json").write_text(json.dumps({**head, "include_covariance": flag}))
    with pytest.raises(ValueError, match=f"describes no policy: {message}"):
        find(str(tmp_path / "x"))


@cases("asks", [False, True])
def test_an_observation_with_the_covariance_or_without_is_refused(asks):
    own, other = (WHOLE, SIZE) if asks else (SIZE, WHOLE)
    (mission,) = missions(problem(include_covariance=not asks))
    policy = LearnedPolicy("x", network(inputs=own), "rate", 2.4, asks)
    with pytest.raises(
        ValueError, match=f"of {own} numbers, this environment gives {other}.*include_covariance={asks}"
    ):
        policy.reset(mission, [0])


def test_an_observation_of_another_size_is_refused():
    wheels = SATELLITES["microsat"].wheels
    (mission,) = missions(problem("microsat", estimator={"name": "momentum", "parameters": "full"}))
    assert wheels.count == 3
    with pytest.raises(ValueError, match="takes observations of 37 numbers"):
        LearnedPolicy("small", network(), "rate", 2.4).reset(mission, seeds("test", 1))


@cases(
    ("damage", "message"),
    [
        (lambda t, j: t.write_bytes(t.read_bytes()[:40]), "its checksum differs"),
        (lambda t, j: j.write_text(j.read_text()[:30]), "is not JSON"),
        (lambda t, j: j.write_text(json.dumps({**json.loads(j.read_text()), "format": 99})), "format 1"),
        (lambda t, j: t.unlink(), "no such file"),
    ],
)
def test_damaged_files_are_refused(tmp_path, damage, message):
    LearnedPolicy("x", network(), "rate", 2.4).save(tmp_path / "x")
    damage(tmp_path / "x.safetensors", tmp_path / "x.json")
    with pytest.raises(ValueError, match=message):
        find(str(tmp_path / "x"))


def test_layers_that_do_not_fit_are_refused_before_a_flight():
    """They failed in flight, with an error of NumPy's."""
    good, (first, *others) = network(), network().weights
    for weights, biases, said in (
        ((first, np.zeros((8, 5), np.float32), others[-1]), good.biases, r"layer 1 .* weight \(8, 5\), bias \(8,\)"),
        ((first[0], *others), good.biases, "layer 0 of the network does not fit"),
        ((np.nan * first, *others), good.biases, "layer 0 of the network holds values that are not finite"),
        (good.weights, good.biases[:2], "as many weights as biases, got 3 and 2"),
        ((), (), "at least one layer"),
    ):
        with pytest.raises(ValueError, match=said):
            Network(weights, biases)


def test_networks_that_do_not_fit_or_are_not_finite_are_refused():
    tensors = network().tensors()
    with pytest.raises(ValueError, match=r"layer 1 of the network does not fit: weight \(8, 5\), bias \(8,\)"):
        Network.from_tensors({**tensors, "weight.1": np.zeros((8, 5), np.float32)})
    with pytest.raises(ValueError, match="not finite"):
        Network.from_tensors({**tensors, "bias.0": np.full(16, np.nan, np.float32)})
    with pytest.raises(ValueError, match=r"weight\.i and bias\.i"):
        Network.from_tensors({"weight.0": tensors["weight.0"]})


@cases(("name", "satellite"), [(n, s) for n in ("generalist", "ppo") for s in BENCHMARK_SATELLITES])
def test_the_exported_graph_acts_as_the_shipped_policy(name, satellite, tmp_path):
    policy = find(name)
    difference, seconds = export(policy, tmp_path / "x.onnx", posed(policy, satellite))
    assert difference <= TOLERANCE
    assert 0.0 < seconds < 0.1
    props = {p.key: p.value for p in onnx.load(tmp_path / "x.onnx").metadata_props}
    assert props == {
        "satellite": satellite,
        "scenario": "default",
        "control": "torque",
        "include_covariance": str(policy.include_covariance),
        "observation": "wheels",
    }


@cases(
    ("commands", "control", "choices"),
    [("rate", "torque", {"activation": "relu", "squashed": True}), ("rate", "rate", {}), ("torque", "torque", {})],
)
def test_the_graph_of_any_network_acts_as_it_does(commands, control, choices, pyramid):
    """Four wheels, the full tensor, and commands beyond what the wheels have."""
    flown = problem(pyramid, "static", control=control)
    size = max(place.stop for place in flown.layout.values())
    net = network(scale=2.0, outputs=3 if commands == "rate" else 4, inputs=size, **choices)
    policy = LearnedPolicy("x", net, commands, 2.4)
    observations = recorded(policy, flown, 60)
    session = session_of(graph(policy, missions(flown)[0]))
    assert largest_difference(session, policy, observations) <= TOLERANCE
    rng = np.random.default_rng(3)
    noisy = observations + 0.3 * rng.standard_normal(observations.shape).astype(np.float32)
    assert largest_difference(session, policy, noisy) <= TOLERANCE
    (whole,) = session.run(None, {"observation": noisy})
    noisy[3, 5], noisy[7, 0], noisy[20] = np.nan, np.inf, -np.inf
    (spoilt,) = session.run(None, {"observation": noisy})
    assert not spoilt[[3, 7, 20]].any()
    rest = np.setdiff1d(np.arange(len(noisy)), [3, 7, 20])
    np.testing.assert_allclose(spoilt[rest], whole[rest], atol=1e-7)


def test_what_is_shipped():
    assert [policy.name for policy in shipped()] == ["generalist", "ppo"]


def test_ratios_over_another_policy_are_by_cell():
    """A policy over itself is 1 in every cell; one that does nothing errs more, and is never outside."""
    settings, policy = PPOSettings(satellite="microsat"), find("generalist")
    nothing = Network((np.zeros((3, 70), np.float32),), (np.zeros(3, np.float32),))
    still = LearnedPolicy("still", nothing, "rate", 2.75, include_covariance=True)
    own, other = ratios([policy, still], policy, settings, 8)
    np.testing.assert_array_equal(own[:, :2], 1.0)
    assert own.shape == (len(INERTIA_MODES), 4)
    assert (other[:, :2] > 3.0).all()
    assert (other[:, 2:] == 0.0).all()
