"""Security: files that came from somewhere else are read as numbers and text, never run, and checked before use."""

import hashlib
import io
import json
import os
import pickle
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from agents.training.ppo import PPOSettings
from agents.training.sb3 import checkpoint
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.learned.files import FILE_SIZE_MAX
from satid_gym.policies.learned.shipped import PRETRAINED, names
from tests.cases import case

ROOT = Path(__file__).parent.parent
# what ruff's S rules do not know: numpy's and torch's doors to pickle, and Stable-Baselines3's zip files
UNPICKLES = re.compile(
    r"allow_pickle=(?!False)|\btorch\.load\((?!.*weights_only=True)|\b\w*(PPO|SAC|TD3|A2C|DQN|DDPG|TQC)\.load\("
    r"|^\s*(import|from) (c?[Pp]ickle|_pickle|cloudpickle|dill|joblib|shelve|marshal|yaml|pandas)\b",
    flags=re.MULTILINE,
)


def test_no_source_unpickles():
    paths = [path for name in ("satid_gym", "baselines", "agents", "docs") for path in (ROOT / name).rglob("*.py")]
    assert len(paths) > 100
    found = [path for path in paths if UNPICKLES.search(path.read_text(encoding="utf-8"))]
    assert [str(path.relative_to(ROOT)) for path in found] == ["baselines/command/cluster.py"]  # its own tasks
    for code in (
        "import pickle", "from cloudpickle import loads", "import yaml", "np.load(path, allow_pickle=True)",
        "torch.load(path)", "torch.load(path, weights_only=False)", "PPO.load('x.zip')", "ExcitationPPO.load('x.zip')",
    ):  # fmt: skip
        assert UNPICKLES.search(code), code


def test_ruff_refuses_what_runs_the_text_of_a_file(tmp_path):
    """`make lint` sees to the sources; here that it would notice."""
    code = "eval(x)", "exec(x)", "os.system(x)", "subprocess.run(x, shell=True)", "pickle.loads(x)", "yaml.load(x)"
    (tmp_path / "wrong.py").write_text("\n".join(["import os, pickle, subprocess, yaml", 'x = input("")', *code]))
    options = ["--config", str(ROOT / "pyproject.toml"), "--output-format", "concise", "--no-cache"]
    check = [sys.executable, "-m", "ruff", "check", *options, str(tmp_path)]
    found = subprocess.run(check, capture_output=True, text=True, check=False).stdout
    assert set(re.findall(r": (S\d+) ", found)) >= {"S307", "S102", "S605", "S602", "S301", "S506"}, found


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


def test_pickles_in_policies_are_refused_and_not_run(tmp_path, mark):
    for content in (pickle.dumps(Malice(mark)), objects(mark)):
        with pytest.raises(ValueError, match="holds no network"):
            LearnedPolicy.load(written(tmp_path, content))
        (tmp_path / "x.json").write_bytes(content)
        with pytest.raises(ValueError, match="is not JSON"):
            LearnedPolicy.load(tmp_path / "x")
        assert not mark.exists()


def test_pickles_in_checkpoints_are_refused_and_not_run(tmp_path, mark):
    path = tmp_path / "checkpoint.npz"
    for content in (pickle.dumps(Malice(mark)), objects(mark)):
        for checksum in (b"", hashlib.sha256(content).digest()):
            path.write_bytes(content + checksum)
            with pytest.raises(ValueError, match=r"checkpoint\.npz is (intact but is )?not"):
                checkpoint.load(path, None, None)  # neither is touched before the file is known to be good
            assert not mark.exists()


NO_NETWORKS = [
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
]
NO_HEADS = [
    {"name": "../../evil"}, {"name": "/etc/passwd"}, {"name": ""}, {"name": "a" * 65}, {"name": "[red]x"},
    {"name": ["x"]}, {"name": None}, {"control": "relu"}, {"control": None}, {"control": ["rate"]},
    {"margin": "many"}, {"margin": float("nan")}, {"margin": float("inf")}, {"margin": -1.0}, {"margin": None},
    {"margin": 10**400}, {"margin": True}, {"margin": "2.4"}, {"margin": [2.4]},
]  # fmt: skip


def test_networks_that_are_none_are_refused(tmp_path):
    for i, content in enumerate(NO_NETWORKS):
        path = written(tmp_path, content)
        with case(i), pytest.raises(ValueError, match=r"x\.safetensors holds no network: ") as error:
            LearnedPolicy.load(path)
        assert len(str(error.value)) < 1000, i


def test_heads_that_describe_no_policy_are_refused(tmp_path):
    for head in NO_HEADS:
        path = written(tmp_path, save(network()), **head)
        with case(head), pytest.raises(ValueError, match=r"x\.json describes no policy"):
            LearnedPolicy.load(path)


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


def test_a_policy_without_the_checksum_of_its_network_is_refused(tmp_path):
    path = written(tmp_path, save(network()))
    head = json.loads((tmp_path / "x.json").read_text())
    assert LearnedPolicy.load(path).name == "x"
    del head["sha256"]
    for more in ({}, *({"sha256": wrong} for wrong in (None, "", 0, ["x"], "0" * 64))):
        (tmp_path / "x.json").write_text(json.dumps(head | more))
        message = r"holds no sha256: copy the policy again|its checksum differs"
        with case(more), pytest.raises(ValueError, match=message):
            LearnedPolicy.load(path)


def test_shipped_policies_have_a_checksum():
    for name in names():
        head = json.loads((PRETRAINED / f"{name}.json").read_text())
        assert head["sha256"] == hashlib.sha256((PRETRAINED / f"{name}.safetensors").read_bytes()).hexdigest(), name


def test_runs_are_not_named_after_folders():
    with pytest.raises(ValueError, match="a policy's name is up to 64"):
        PPOSettings(name="../elsewhere")
