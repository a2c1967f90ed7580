"""Source of the translated core: records, their values before the flight, and the functions that the pilot calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from satid_gym.control.decoded_observation import PlantConstants
from satid_gym.control.rate_loop import drive_many
from satid_gym.core.belief import filters
from satid_gym.core.observed_number import BOUND, LOG_OFFSET
from satid_gym.core.records import FLOAT
from satid_gym.core.report import note_peaks
from satid_gym.estimators.records import new_work
from satid_gym.flightcode.c_types import (
    DOUBLE,
    INT,
    Array,
    Record,
    Type,
    declared,
    initialiser,
    number,
    record_of,
    record_structs,
)
from satid_gym.flightcode.layout import lines_of
from satid_gym.flightcode.policy_files import PolicySource
from satid_gym.flightcode.sources import Source, stored_fields
from satid_gym.flightcode.translator import Translator
from satid_gym.onboard import kernels
from satid_gym.onboard.pilot import Pilot
from satid_gym.templates import build_templates

_STORED = {"substeps", "decision", "nis_sum", "nis_count", "rejected"}  # by satid_pilot.c


class CoreSource:
    """Header and source of the core for one data sheet.

    Args:
        pilot: whose filter and rate loop it is.
        policy: whose functions it has too.
        counting: whether the code counts its operations.

    Attributes:
        header, source: texts of satid_core.h and satid_core.c.
    """

    def __init__(self, pilot: Pilot, policy: PolicySource, counting: bool = False) -> None:
        first = build_templates(pilot.problem).records
        self._belief, self._task = first.beliefs, first.tasks
        called: list[Callable[..., Any]] = [
            kernels.begin,
            kernels.take,
            kernels.cross_gap,
            kernels.steer,
            kernels.let_go,
            filters.tell,
            note_peaks,
        ]
        changing = stored_fields(called) | _STORED
        n, p = pilot.problem.wheels, self._belief["prior_theta"].shape[1]
        size = max(place.stop for place in pilot.problem.layout.values())
        belief = record_of("satid_belief", self._belief.dtype, self._belief[0], changing)
        task = record_of("satid_task", self._task.dtype, self._task[0], changing)
        work = record_of("satid_work", new_work(self._belief).dtype)
        readings = record_of("satid_readings", kernels.readings_dtype(n))
        report = record_of("satid_report", kernels.report_dtype())
        self._values = {belief: self._belief[0], task: self._task[0]}
        self._records = [readings, belief, task, work, report]
        self._translator = Translator(counting)
        self._wrappers: list[str] = []
        self._prototypes: list[str] = []
        some = [("readings", _one(readings)), ("belief", _one(belief)), ("task", _one(task)), ("work", _one(work))]
        seconds, observation = ("dt", DOUBLE), ("observation", Array("float", (1, size)))
        self._add("begin", kernels.begin, [*some, observation])
        self._add("take", kernels.take, [*some, seconds, observation])
        self._add("cross_gap", kernels.cross_gap, [*some[1:3], ("gap", DOUBLE)])
        if pilot.problem.control == "rate":
            self._add("steer", kernels.steer, [*some, seconds])
            self._add("let_go", kernels.let_go, [some[2]])
        self._add("tell", filters.tell, [("belief", belief), ("report", report)])
        self._add("note_peaks", note_peaks, [("readings", readings), ("belief", belief), ("report", report)])
        if policy.constants is not None:
            self._add_drive(policy.constants, n, p)
        if policy.mode_functions:
            self._add_modes(policy, len(self._belief["modes"]["frequency"][0]))
        self.header, self.source = self._header(pilot), self._source()

    def _add_drive(self, constants: PlantConstants, n: int, p: int) -> None:
        shapes = {"omega": (3,), "wheel_momentum": (n,), "inertia": (3, 3), "inertia_std": (p,), "momentum": (3,)}
        decoded_dtype = np.dtype([(k, FLOAT, (1, *v)) for k, v in {**shapes, "disturbance": (3,)}.items()])
        decoded = record_of("satid_decoded", decoded_dtype)
        own_dtype = np.dtype([(name, FLOAT, values.shape) for name, values in constants._asdict().items()])
        own = record_of("satid_constants", own_dtype)
        self._values[own] = constants._asdict()
        self._records += [decoded, own]
        commands, actions = Array("double", (1, 3)), Array("double", (1, n))
        given: list[tuple[str, Type]] = [("decoded", decoded), ("commands", commands), ("own", own)]
        given += [("margin", DOUBLE), ("period", DOUBLE), ("actions", actions)]
        self._add("drive", drive_many, given)

    def _add_modes(self, policy: PolicySource, m: int) -> None:
        own = {"rate": (3,), "most": (3,), "swing": (m, 2), "direction": (m, 3), "bent": (m,), "turn": (m, 2)}
        shapes = {**own, "turned": (m,), "limit": (m,), "pull": (m, 6)}
        modes = record_of("satid_modes", np.dtype([(name, FLOAT, (1, *shape)) for name, shape in shapes.items()]))
        self._records.append(modes)
        given: dict[str, Type] = {"modes": modes, "pulled": Array("double", (1, policy.choices, m))}
        given |= dict.fromkeys(("wanted", "rates", "choices"), Array("double", (1, policy.choices, 3)))
        given |= dict.fromkeys(("held", "edge", "most"), Array("double", (1, 3)))
        given |= {"share": Array("double", (1,)), "peaks": Array("double", (1, policy.choices))}
        given |= {"lag": DOUBLE, "decisions": INT}
        for function in policy.mode_functions:
            source = Source(function)
            self._add(source.tree.name.removesuffix("_many"), function, [(one, given[one]) for one in source.arguments])

    def _add(self, name: str, function: Callable[..., Any], given: list[tuple[str, Type]]) -> None:
        """Make a function known to the pilot as satid_core_NAME."""
        called, result = self._translator.call(function, [kind for _, kind in given])
        kind = "void" if result is None else declared(result, "").strip()
        parameters = ", ".join(declared(kind, parameter) for parameter, kind in given)
        prototype = f"{kind} satid_core_{name}({parameters})"
        arguments = ", ".join(parameter for parameter, _ in given)
        self._prototypes.append(f"{prototype};")
        self._wrappers.append(f"{prototype}\n{{\n    {'' if result is None else 'return '}{called}({arguments});\n}}\n")

    def _header(self, pilot: Pilot) -> str:
        structs = [text for record in self._records for text in record_structs(record)]
        firsts = [f"extern const {record.name} {_first(record)};" for record in self._values]
        return "\n".join(
            [
                "/* Records of filter, task and rate loop, and the functions that work on them. */",
                "#ifndef SATID_CORE_H\n#define SATID_CORE_H\n",
                '#include <stdbool.h>\n#include <stddef.h>\n#include <stdint.h>\n\n#include "satid_math.h"\n',
                *self._numbers(pilot),
                "",
                *structs,
                "/* values before the flight */",
                *firsts,
                "",
                *self._prototypes,
                "\n#endif\n",
            ]
        )

    def _numbers(self, pilot: Pilot) -> list[str]:
        """Numbers of the data sheet and the scenario that the pilot needs."""
        world, belief, task = pilot.problem.scenario, self._belief[0], self._task[0]
        numbers: dict[str, int | float] = {
            "WHEELS": pilot.problem.wheels,
            "ACTIONS": pilot.problem.actions,
            "PARAMETERS": len(belief["prior_theta"]),
            "STATES": len(belief["mean"]),
            "MODES": len(belief["modes"]["frequency"]),
            "OBSERVATION": max(place.stop for place in pilot.problem.layout.values()),
            "TRACKER": int(pilot.mission.prior.sensors.star_tracker is not None),
            "RATE_CONTROL": int(pilot.problem.control == "rate"),
            "SAMPLE_PERIOD": world.sample_period,
            "SAMPLES": world.samples,
            "DECISION_PERIOD": world.decision_period,
            "DECISIONS": world.decisions,
            "PATIENCE": pilot.patience,
            "RATE_LIMIT": float(task["rate_limit"]),
            "SUBSTEPS": int(belief["substeps"]),
            "SCALE_VARIANCE": float(belief["scale_variance"]),
            "BOUND": BOUND,
            "LOG_OFFSET": LOG_OFFSET,
        }
        places = [f"#define SATID_AT_{name.upper()} {place.start}" for name, place in pilot.problem.layout.items()]
        return [*(f"#define SATID_{name} {number(value)}" for name, value in numbers.items()), *places]

    def _source(self) -> str:
        firsts = [
            f"const {record.name} {_first(record)} = {initialiser(record, values)};\n"
            for record, values in self._values.items()
        ]
        parts = [
            "/* Translated from satid_gym.core by satid_gym.flightcode; the equations and their sources are there. */",
            '#include "satid_core.h"\n',
            *self._translator.structs.values(),
            "",
            *firsts,
            *self._translator.definitions,
            *self._wrappers,
        ]
        return lines_of("\n".join(parts))


def _one(record: Record) -> Array:
    return Array(record, (1,))


def _first(record: Record) -> str:
    return record.name.replace("satid_", "satid_first_", 1)
