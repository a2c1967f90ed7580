"""Options that several commands have: types whose help lists what the registries hold."""

from __future__ import annotations

from typing import Annotated

import tyro

from satid_gym.scenario_catalogue import SCENARIOS

_NAMES = "|".join(SCENARIOS)

ScenarioText = Annotated[str, tyro.conf.arg(metavar=f"{{{_NAMES}|FILE|MODULE:NAME}}")]
"""Scenario by name, by file or by module:name."""

ScenarioName = Annotated[str, tyro.conf.arg(metavar=f"{{{_NAMES}|NAME}}")]
"""Scenario by name alone, also by that of a custom one."""
