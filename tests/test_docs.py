"""The pages: their code runs, their commands parse, their tables are those of the code."""

import argparse
import importlib.util
import inspect
import itertools
import json
import re
import runpy
import shlex
import sys
import tomllib
import warnings

import gymnasium
import numpy as np
import pytest
import torch
import tyro

import baselines
import satid_gym
import satid_gym.estimators
from agents.docs import tables
from agents.docs.readme import ROOT
from agents.training.ppo import PPOSettings
from satid_gym import RewardSettings, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.commands import lead
from satid_gym.commands.main import parser
from satid_gym.gym_api import INFO_KEYS, RESET_OPTIONS
from satid_gym.problem import problem
from tests.cases import case, cases

PAGES = {path.name: path.read_text() for path in sorted((ROOT / "docs").glob("*.md")) if path.name != "README.md"}
PAGES |= {f"notes/{path.name}": path.read_text() for path in sorted((ROOT / "docs" / "notes").glob("*.md"))}
PAGES |= {name: (ROOT / name).read_text() for name in ("README.md", "CONTRIBUTING.md", "docs/README.md")}


def blocks(text, language):
    """Fenced blocks of one language, "" for those without."""
    return [
        body for kind, body in re.findall(r"^```(.*?)\n(.*?)^```$", text, flags=re.DOTALL | re.M) if kind == language
    ]


def commands(text):
    """Command lines of the blocks, and of inline code what has options and none left out."""
    lines = [line for language in ("", "bash", "sh") for block in blocks(text, language) for line in block.splitlines()]
    lines += re.findall(r"^    ((?:python -m|make|pip) .*)$", text, flags=re.M)  # blocks by indentation
    inline = (
        " ".join(code.split())
        for code in re.findall(r"`([^`]+)`", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.M))
    )
    named = [code for code in inline if re.match(r"(python -m|make) \S", code) and "..." not in code]
    return [words for words in (shlex.split(line, comments=True) for line in [*lines, *named]) if words]


# code


@pytest.fixture(autouse=True)
def _one_thread_for_torch():
    torch.set_num_threads(1)  # the tests run side by side: threads that wait for each other's cores take a minute


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page, text in PAGES.items() if blocks(text, "python")])
def test_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace = {}
    for block in blocks(PAGES[page], "python"):
        if page == "README.md":  # each of its blocks is there to be copied alone
            namespace = {}
        exec(compile(block, page, "exec"), namespace)


def example(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")


def test_first_steps():
    left = example("01_first_steps.py")
    assert left["truncated"]
    assert left["info"]["relative_error"] < 0.01


@pytest.mark.slow
def test_a_policy_trained_in_seconds_beats_scripted_ones():
    errors = example("02_train_your_own_policy.py")["errors"]
    assert errors["mine"] < min(errors["sine"], errors["staggered_square"])


@pytest.mark.slow
def test_own_satellite_and_estimator():
    errors = example("03_bring_your_own_satellite_and_estimator.py")["errors"]
    assert len(errors) == 2
    assert max(errors.values()) < 0.01


def test_a_flight_outside_the_environment():
    left = example("04_fly_a_satellite_of_your_own.py")
    assert left["pilot"].status.state == "over"
    assert left["error"] < 0.001


def test_every_example_is_shown_and_tested():
    files = [path.name for path in sorted((ROOT / "examples").glob("*.py"))]
    lanes = [ROOT / "tests" / "test_basilisk.py", *(ROOT / "tests").glob("test_reach_*.py")]
    tested = inspect.getsource(sys.modules[__name__]) + "".join(path.read_text() for path in lanes)
    for file in files:
        assert f'--8<-- "examples/{file}"' in PAGES["examples.md"]
        assert f'example("{file}")' in tested


# commands


class ParsedError(Exception):
    """Raised in place of running a command whose options were understood."""


def parse(module, arguments, monkeypatch):
    """Run a module as a command up to where its options are read."""

    def reading(original):
        def read(*args, **settings):
            original(*args, **settings)
            raise ParsedError

        return read

    monkeypatch.setattr(sys, "argv", [module, *arguments])
    monkeypatch.setattr(tyro, "cli", reading(tyro.cli))
    if module.startswith("satid_gym"):  # the library does without tyro
        monkeypatch.setattr(argparse.ArgumentParser, "parse_args", reading(argparse.ArgumentParser.parse_args))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # runpy's, of modules that were imported before
        runpy.run_module(module, run_name="__main__", alter_sys=True)


def has_options(module):
    spec = importlib.util.find_spec(module)
    if spec.submodule_search_locations:
        spec = importlib.util.find_spec(f"{module}.__main__")
    text = (ROOT / spec.origin).read_text()
    return re.search(r"cli\.run\(|ArgumentParser\(", text, flags=re.M) is not None


def extras(requirement):
    return re.findall(r"[\w-]+", requirement.partition("[")[2])


def check_tests(path, *selection):
    """A test file, and with `-k` a part of the name of a test in it; `-s` shows what it prints."""
    text = (ROOT / path).read_text()
    if selection:
        option, part = (word for word in selection if word != "-s")
        assert option == "-k"
        assert re.search(rf"^def test_\w*{part}", text, flags=re.M), f"{path} has no test named like {part}"


def check_command(words, folder, monkeypatch):
    """A line of a page names a program, a module and options that there are; nothing is run."""
    if words[0].startswith("PYTHONPATH="):
        words = words[1:]
    program, *rest = words
    if program == "make":
        (target,) = rest
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), flags=re.M)
    elif rest[:1] == ["install"] or rest[:3] == ["-m", "pip", "install"]:
        known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        assert set(itertools.chain.from_iterable(map(extras, rest))) <= set(known)
    elif program == "satid":
        if rest[0] not in lead.MODULES:  # those have the options of the checkout's commands
            parser().parse_args(rest)
    elif program == "source":
        assert rest == [".venv/bin/activate"]
    elif program == "python" and rest[0] != "-m":
        assert (ROOT / rest[0]).is_file()
    else:
        assert program == "python", f"no check for {program}; add one to this test"
        module, arguments = rest[1], rest[2:]
        assert importlib.util.find_spec(module), f"there is no module {module}"
        if module == "pytest":
            check_tests(*arguments)
        elif not has_options(module):
            assert not arguments, f"{module} takes no options"
        elif arguments:
            monkeypatch.chdir(folder)
            for name, text in WRITTEN:
                (folder / name).write_text(text)
            if "--resume" in arguments:
                run = folder / arguments[arguments.index("--run") + 1]
                run.mkdir(parents=True)
                (run / "run.json").write_text(json.dumps({"settings": PPOSettings().to_dict()}))
            with pytest.raises(ParsedError):
                parse(module, arguments, monkeypatch)


WRITTEN = re.findall(
    r'Path\("([\w.]+)"\)\.write_text\("""(.*?)"""\)', PAGES["extend.md"], flags=re.DOTALL
)  # files to fly


def check_files(text):
    """Files and folders of the checkout that a page names."""
    named = re.findall(r"`((?:satid_gym|agents|baselines|tests|docs|examples)/[\w/.-]*)`", text)
    assert [path for path in named if not (ROOT / path).exists()] == []


def check_links(page):
    """Pages and headings that a page links to."""
    here = ROOT / (page if page in ("README.md", "CONTRIBUTING.md", "docs/README.md") else f"docs/{page}")
    for target in re.findall(r"\]\(([^)]+)\)", re.sub(r"^```.*?^```", "", PAGES[page], flags=re.DOTALL | re.M)):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        file = (here.parent / path) if path else here
        assert file.exists(), f"{page} links to {target}"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", file.read_text(), flags=re.M)
            assert anchor in {re.sub(r"[^\w -]", "", h.lower()).strip().replace(" ", "-") for h in headings}, target


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_names_exists(page, tmp_path, monkeypatch):
    """Its files, its links and its commands with their options."""
    check_files(PAGES[page])
    check_links(page)
    for number, line in enumerate(sorted({shlex.join(words) for words in commands(PAGES[page])})):
        folder = tmp_path / str(number)
        folder.mkdir()
        with case(line), monkeypatch.context() as patch:
            check_command(shlex.split(line), folder, patch)


def test_a_wrong_option_would_be_noticed(monkeypatch):
    with pytest.raises(SystemExit):
        parse("agents.compare", ["--episode", "3"], monkeypatch)
    with pytest.raises(SystemExit):
        parse("satid_gym.benchmark", ["--outputs", "x"], monkeypatch)


# tables


@cases("page", tables.PAGES)
def test_tables_are_those_of_the_code(page):
    assert tables.written(page, PAGES[page]) == PAGES[page], "run python -m agents.docs.tables"


def table(page, heading):
    """Rows below a heading, as lists of cells without code marks; head and rule left out."""
    section = re.split(rf"^## {heading}\n", PAGES[page], flags=re.M)[1]
    section = re.split(r"^## ", section, flags=re.M)[0]
    rows = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip().replace("`", "") for cell in row.strip("|").split("|")] for row in rows if "---" not in row]


@cases(("code", "decisions", "horizon"), table("faq.md", r"How do I change the length of an episode\?")[1:])
def test_an_episode_is_as_long_as_the_table_says(code, decisions, horizon):
    env = eval(code, {"gymnasium": gymnasium, "satid_gym": satid_gym})
    vector = hasattr(env, "num_envs")
    place = problem().layout["time_left"]
    observation, _ = env.reset(seed=0)
    action, count, over = np.zeros(env.action_space.shape, np.float32), 0, np.array(False)
    while not over.any():
        observation, _, terminated, truncated, _ = env.step(action)
        count, over = count + 1, np.asarray(truncated)
        assert not np.any(terminated)
        if count == 1:
            left = (observation[0] if vector else observation)[place]
            assert left == pytest.approx(1.0 - 1.0 / int(horizon), abs=1e-6)
    env.close()
    assert count == int(decisions)


@cases(("estimator", "states"), [("momentum", "p + 6"), ("rate", "p + 3 + n")])
@cases(("n", "p"), [(3, 3), (4, 6)])
def test_observation_table_is_the_layout(n, p, estimator, states, pyramid):
    assert f"$s = {states}$" in PAGES["environment.md"]
    sizes = {"n": n, "p": p, "3 p": 3 * p, "3": 3, "1": 1}
    s = {"p + 6": p + 6, "p + 3 + n": p + 3 + n}[states]
    sizes |= {"s - p": s - p, "s (s - 1) / 2 - 3 p": s * (s - 1) // 2 - 3 * p}
    rows = table("environment.md", "Observation")[1:]
    kind = {"name": estimator, "parameters": "principal" if p == 3 else "full"}
    satellite = "microsat" if n == 3 else pyramid
    places = problem(satellite, estimator=kind, include_covariance=True).layout
    assert [(name, sizes[size]) for name, size, _ in rows] == [(k, v.stop - v.start) for k, v in places.items()]
    assert places["time_left"].stop == 16 + 2 * n + 5 * p
    assert list(places.items())[:-2] == list(problem(satellite, estimator=kind).layout.items())


def test_info_table_is_what_info_holds():
    _, info = SatInertiaIDEnv().reset(seed=0)
    names = ", ".join(row[0] for row in table("environment.md", "Info")[1:])
    assert names.split(", ") == list(INFO_KEYS) == list(info)


def test_reward_of_the_docstring_has_the_defaults():
    reward = inspect.getdoc(SatInertiaIDEnv).partition("## Reward")[2].partition("## Starting state")[0]
    said = re.findall(r"^\| (\w+) \| ([\d.]+) \|", reward, flags=re.M)
    names = {"gained": "gain_scale", "held": "held_scale", "excess": "envelope_weight"}
    names |= {"saturated": "saturation_weight", "bent": "deflection_weight"}
    names |= {"in_band": "avoided_band_weight", "effort": "effort_weight"}
    defaults = RewardSettings().to_dict()
    assert {names[term]: float(value) for term, value in said} == {name: defaults[name] for name in names.values()}


def test_argument_tables_are_the_signatures():
    rows = [row[0] for row in table("environment.md", "Arguments")]
    single = list(inspect.signature(SatInertiaIDEnv).parameters)
    vector = [name for name in inspect.signature(SatInertiaIDVectorEnv).parameters if name not in single]
    assert [name for name in rows if name not in ("argument", "option")] == [
        *single, *vector, *RESET_OPTIONS, "reset_mask"
    ]  # fmt: skip


# the reference, and the site's own tools


@cases("package", [satid_gym, satid_gym.estimators, baselines])
def test_reference_has_the_home_of_every_public_name(package):
    reference = "".join(path.read_text() for path in (ROOT / "docs" / "api").glob("*.md"))
    shown = set(re.findall(r"^::: ([\w.]+)$", reference, flags=re.M))
    for name in package.__all__:
        value = getattr(package, name)
        home = getattr(value, "__module__", None) or getattr(value, "__name__", package.__name__)
        if inspect.isclass(value) or inspect.isroutine(value):
            assert shown & {home, f"{home}.{name}"}, f"{home}.{name} is in no page of docs/api"


def tool(name):
    return runpy.run_path(str(ROOT / "docs" / "site" / name))


def test_reference_of_commands_has_their_options():
    sections = {text.split("\n")[0]: text for text in tool("commands.py")["of"]("agents")}
    assert "| `policy` | required |" in sections["## agents.evaluate"]
    assert "| `--seed-split` | `validation` |" in sections["## agents.evaluate"]
    assert "| `--seed-split` | `test` |" in sections["## agents.compare"]
    assert "| `--steps` | `1000000` |" in sections["## agents.train"]


def test_formulas_become_mathml():
    page = '<p><span class="arithmatex">\\(a &lt; b\\)</span></p><div class="arithmatex">\\[\n\\dot M = u\n\\]</div>'
    made = tool("mathml.py")["on_page_content"](page)
    assert made.count("<math") == 2
    assert "arithmatex" not in made
    assert made.count('display="block"') == 1
