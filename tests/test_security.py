"""Security: files that came from somewhere else are read as numbers and text, never run, and checked before use."""

import ast
import hashlib
import io
import json
import os
import pickle
import struct
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from agents.training.ppo import PPOSettings
from agents.training.sb3 import checkpoint
from satid_gym.policies.learned import FILE_SIZE_MAX, LearnedPolicy, Network
from satid_gym.policies.shipped import PRETRAINED, names

ROOT = Path(__file__).parent.parent
SOURCES = sorted(
    path
    for folder in ("satid_gym", "baselines", "agents", "docs", "examples")
    for path in (ROOT / folder).rglob("*.py")
)
UNPICKLERS = {"pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal", "yaml", "pandas"}
RUNNERS = {"eval", "exec", "compile", "__import__"}
ALGORITHMS = {"PPO", "SAC", "TD3", "A2C", "DQN", "DDPG", "TQC", "RecurrentPPO", "ExcitationPPO"}


def dangers(tree: ast.AST) -> list[str]:
    """What in a module may run code that a file holds."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [f"import {a.name}" for a in node.names if a.name.split(".")[0] in UNPICKLERS]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in UNPICKLERS:
            found.append(f"from {node.module}")
        elif isinstance(node, ast.Call):
            found += _dangerous_call(node)
    return found


def _dangerous_call(node: ast.Call) -> list[str]:
    given = {k.arg: k.value.value for k in node.keywords if isinstance(k.value, ast.Constant)}
    called = ast.unparse(node.func)
    owner, _, name = called.rpartition(".")
    if called in RUNNERS or called in ("os.system", "os.popen", "runpy.run_path"):
        return [called]
    if given.get("shell") or given.get("allow_pickle"):
        return [f"{called} with shell or allow_pickle"]
    if (owner, name) in (("np", "load"), ("numpy", "load")) and given.get("allow_pickle", True):
        return [f"{called} without allow_pickle=False"]
    if name == "load" and (owner in ALGORITHMS or (owner == "torch" and not given.get("weights_only"))):
        return [called]
    return []


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_source_unpickles_or_evaluates(path):
    assert dangers(ast.parse(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "code",
    [
        "import pickle", "from cloudpickle import loads", "import yaml", "eval('1')", "exec(text)", "np.load(path)",
        "np.load(path, allow_pickle=True)", "torch.load(path)", "torch.load(path, weights_only=False)",
        "PPO.load('x.zip')", "os.system('ls')", "subprocess.run('ls', shell=True)",
    ],
)  # fmt: skip
def test_the_check_sees_what_is_dangerous(code):
    assert dangers(ast.parse(code))


class Malice:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.fixture
def mark(tmp_path):
    """A folder that malice makes: its pickles work, and nothing else may run them."""
    path = tmp_path / "mark"
    pickle.loads(pickle.dumps(Malice(path)))
    path.rmdir()
    return path


def objects(mark):
    """A file of numpy with a pickle in it."""
    file = io.BytesIO()
    np.savez(file, head=np.array([Malice(mark)], dtype=object))
    return file.getvalue()


def header(text):
    """A file of safetensors with a header of one's own, and no data."""
    return struct.pack("<Q", len(text)) + text


def network(**changed):
    rng = np.random.default_rng(0)
    tensors = {
        "weight.0": rng.standard_normal((8, 37)).astype(np.float32), "bias.0": np.zeros(8, np.float32),
        "weight.1": rng.standard_normal((3, 8)).astype(np.float32), "bias.1": np.zeros(3, np.float32),
    }  # fmt: skip
    return {k: v for k, v in (tensors | changed).items() if v is not None}


def written(tmp_path, content, **head):
    """A policy's pair of files with any content and head; `None` leaves a name out."""
    described = {"format": 1, "name": "x", "control": "rate", "margin": 2.4}
    described |= {"sha256": hashlib.sha256(content).hexdigest()} | head
    described = {k: v for k, v in described.items() if v is not None}
    (tmp_path / "x.safetensors").write_bytes(content)
    (tmp_path / "x.json").write_text(json.dumps(described))
    return tmp_path / "x"


@pytest.mark.parametrize("foreign", [lambda m: pickle.dumps(Malice(m)), objects], ids=["pickle", "npz"])
def test_pickles_in_policies_are_refused_and_not_run(tmp_path, mark, foreign):
    with pytest.raises(ValueError, match="holds no network"):
        LearnedPolicy.load(written(tmp_path, foreign(mark)))
    (tmp_path / "x.json").write_bytes(foreign(mark))
    with pytest.raises(ValueError, match="is not JSON"):
        LearnedPolicy.load(tmp_path / "x")
    assert not mark.exists()


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("foreign", [lambda m: pickle.dumps(Malice(m)), objects], ids=["pickle", "npz"])
def test_pickles_in_checkpoints_are_refused_and_not_run(tmp_path, mark, foreign, signed):
    content = foreign(mark)
    path = tmp_path / "checkpoint.npz"
    path.write_bytes(content + hashlib.sha256(content).digest() if signed else content)
    with pytest.raises(ValueError, match=r"checkpoint\.npz is not"):
        checkpoint.load(path, None, None)  # neither is touched before the file is known to be good
    assert not mark.exists()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        header(b"{"),
        struct.pack("<Q", 2**63) + b"{}",
        header(json.dumps({"weight.0": {"dtype": "F32", "shape": [2**40, 2**40], "data_offsets": [0, 8]}}).encode()),
        header(json.dumps({"weight.0": {"dtype": "F32", "shape": [2, 2], "data_offsets": [0, 2**50]}}).encode()),
        header(json.dumps({"../../weight.0": {"dtype": "F32", "shape": [0], "data_offsets": [0, 0]}}).encode()),
        save(network(**{"weight.0": np.full((8, 37), np.nan, np.float32)})),
        save(network(**{"weight.1": np.full((3, 8), np.inf, np.float32)})),
        save(network(**{"weight.1": np.zeros((3, 9), np.float32)})),
        save(network(**{"weight.0": np.zeros((0, 37), np.float32), "bias.0": np.zeros(0, np.float32)})),
        save(network(**{"weight.0": np.zeros((8, 37), np.float64)})),
        save(network(**{"bias.1": None})),
        save(network(**{"../../bias.2": np.zeros(3, np.float32)})),
    ],
    ids=range(13),
)
def test_networks_that_are_none_are_refused(tmp_path, content):
    with pytest.raises(ValueError, match=r"x\.safetensors holds no network: ") as error:
        LearnedPolicy.load(written(tmp_path, content))
    assert len(str(error.value)) < 1000


@pytest.mark.parametrize(
    "head",
    [
        {"name": "../../evil"}, {"name": "/etc/passwd"}, {"name": ""}, {"name": "a" * 65}, {"name": "[red]x"},
        {"name": ["x"]}, {"name": None}, {"control": "relu"}, {"control": None}, {"control": ["rate"]},
        {"margin": "many"}, {"margin": float("nan")}, {"margin": float("inf")}, {"margin": -1.0}, {"margin": None},
        {"margin": 10**400}, {"margin": True}, {"margin": "2.4"}, {"margin": [2.4]},
    ],
    ids=lambda head: str(head)[:40],
)  # fmt: skip
def test_heads_that_describe_no_policy_are_refused(tmp_path, head):
    with pytest.raises(ValueError, match=r"x\.json describes no policy"):
        LearnedPolicy.load(written(tmp_path, save(network()), **head))


def test_a_network_that_commands_too_few_or_too_many_rates_is_refused(tmp_path):
    tensors = network(**{"weight.1": np.zeros((4, 8), np.float32), "bias.1": np.zeros(4, np.float32)})
    with pytest.raises(ValueError, match="has 3 outputs, not 4"):
        LearnedPolicy.load(written(tmp_path, save(tensors)))


def test_files_that_are_too_large_are_not_read(tmp_path):
    path = written(tmp_path, b"")
    os.truncate(tmp_path / "x.safetensors", FILE_SIZE_MAX + 1)
    with pytest.raises(ValueError, match="a policy at most"):
        LearnedPolicy.load(path)


def test_a_flipped_bit_in_a_policy_is_found(tmp_path):
    tensors = network()
    LearnedPolicy("x", Network.from_tensors(tensors), "rate", 2.4).save(tmp_path / "x")
    path = tmp_path / "x.safetensors"
    content = bytearray(path.read_bytes())
    content[-5] ^= 4
    path.write_bytes(content)
    with pytest.raises(ValueError, match="its checksum differs"):
        LearnedPolicy.load(tmp_path / "x")


@pytest.mark.parametrize("checksum", ["missing", None, "", 0, ["x"], "0" * 64], ids=str)
def test_a_policy_without_the_checksum_of_its_network_is_refused(tmp_path, checksum):
    path = written(tmp_path, save(network()))
    head = json.loads((tmp_path / "x.json").read_text())
    assert LearnedPolicy.load(path).name == "x"
    head = {k: v for k, v in head.items() if k != "sha256"} if checksum == "missing" else head | {"sha256": checksum}
    (tmp_path / "x.json").write_text(json.dumps(head))
    with pytest.raises(ValueError, match=r"holds no sha256: copy the policy again|its checksum differs"):
        LearnedPolicy.load(path)


@pytest.mark.parametrize("name", names())
def test_shipped_policies_have_a_checksum(name):
    head = json.loads((PRETRAINED / f"{name}.json").read_text())
    assert head["sha256"] == hashlib.sha256((PRETRAINED / f"{name}.safetensors").read_bytes()).hexdigest()


def test_runs_are_not_named_after_folders():
    with pytest.raises(ValueError, match="a policy's name is up to 64"):
        PPOSettings(name="../elsewhere")
