"""The compiler's cache, for what numba's own leaves open."""

import pytest

from satid_gym.core import kernels
from satid_gym.core.jit import NamedByContent


def test_processes_that_save_at_once_do_not_take_each_others_files(tmp_path):
    one, other = (NamedByContent(tmp_path, "kernel", "stamp") for _ in range(2))
    other._load_index = dict  # it read the index before `one` wrote it
    one.save("signature of one", "code of one")
    other.save("signature of other", "code of other")
    fresh = NamedByContent(tmp_path, "kernel", "stamp")
    assert fresh.load("signature of other") == "code of other"
    assert fresh.load("signature of one") in (None, "code of one")
    one.save("signature of one", "code of one")
    assert [fresh.load(f"signature of {name}") for name in ("one", "other")] == ["code of one", "code of other"]


@pytest.mark.compiled
def test_kernels_use_it():
    assert type(kernels.start_filter._cache._cache_file) is NamedByContent
