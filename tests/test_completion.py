"""`hapticd --completion`: a script that the shell accepts and that completes commands and options."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from hapticd.__main__ import COMMANDS, main

COMPLETE = """
source {script}
COMP_WORDS=({words}) COMP_CWORD={last}
_shtab_hapticd
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.mark.long
def test_bash_completes_commands_and_their_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["--completion", "bash"])
    script = tmp_path / "hapticd"
    script.write_text(capsys.readouterr().out)

    def completed(*words: str) -> set[str]:
        text = COMPLETE.format(script=script, words=shlex.join(["hapticd", *words]), last=len(words))
        bash = str(shutil.which("bash"))
        done = subprocess.run([bash, "-c", text], capture_output=True, text=True, check=True, timeout=60)
        return set(done.stdout.split())

    assert set(COMMANDS) <= completed("")
    assert completed("sim") == {"simulate"}
    assert {"--seed", "--scenario"} & completed("simulate", "--s")
    assert "--participant" in completed("calibrate", "friction", "--p")
