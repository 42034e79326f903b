"""A controller or node that is silent is shown as such: the logic of the page, run by Node.js."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import iptm_view

PAGE = Path(iptm_view.__file__).parent / "page"
NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(NODE is None, reason="without Node.js")


def answered(script: str) -> Any:
    done = subprocess.run(
        [str(NODE), "--input-type=module", "-e", script],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return json.loads(done.stdout)


def test_decisions_that_end_are_silent_from_the_third_row_on() -> None:
    rows = [[t, 1 if t <= 61 else None] for t in range(80)]
    found = answered(
        f"""
        import {{ Run }} from "{PAGE / "run.js"}";
        const run = new Run();
        const facts = {{ columns: ["time_s", "status_code"], limits: null, notes: [] }};
        Object.assign(facts, {{ statuses: {{}}, rungs: {{}} }});
        run.set("facts", facts);
        run.addRows({json.dumps(rows)});
        console.log(JSON.stringify([60, 63, 64, 79].map((time) => run.silentSince(time))));
        """
    )
    assert found == [None, None, 61, 61]


def test_a_warning_of_the_transport_is_no_intervention() -> None:
    found = answered(
        f"""
        import {{ Run }} from "{PAGE / "run.js"}";
        import {{ FIGURES }} from "{PAGE / "panels.js"}";
        const run = new Run();
        const facts = {{ columns: ["time_s", "gap_m"], limits: null, notes: [], statuses: {{}} }};
        run.set("facts", {{ ...facts, rungs: {{}} }});
        run.addRows([[40, 9], [41, 8]]);
        const change = (level) => ({{ time_s: 41, level, name: "/plant", reason: level }});
        run.addChanges([change("WARN"), change("ERROR")]);
        const count = FIGURES.find((figure) => figure.id === "events").of(run, 41);
        console.log(JSON.stringify([run.events.length, count]));
        """
    )
    assert found == [2, [1, "/plant: ERROR", True]]


def test_a_status_is_silent_after_twice_its_usual_time() -> None:
    found = answered(
        f"""
        globalThis.document = {{}};
        const {{ silence }} = await import("{PAGE / "diagnostics.js"}");
        const ages = [62, 63, 64].map((now) => silence(now, 61, 1, 1));
        ages.push(silence(71, 61, 5, 1), silence(200, 61, 5, 1), silence(null, 61, 1, 1));
        ages.push(silence(120, 0, 0, 1));
        console.log(JSON.stringify(ages));
        """
    )
    assert found == [None, None, 3, None, 139, None, None]
