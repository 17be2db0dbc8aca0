"""The command `impostor-jax parity`."""

__all__ = ["ParityCommand"]

import dataclasses
from pathlib import Path
from typing import Literal

from impostor_jax.io.atomic import check_output_folder


@dataclasses.dataclass(frozen=True)
class ParityCommand:
    """Compare JAX with the GLSL impostors, drawn by a real OpenGL driver.

    Writes parity.json, parity.md and a picture of each case; exit code 1 where a
    difference is larger than its bound.
    """

    camera: Literal["perspective", "orthographic", "all"] = "all"
    """Kind of camera."""
    cases: tuple[str, ...] = ("all",)
    """Names of cases or patterns of them, such as 'perspective/distance *'."""
    driver: Literal["llvmpipe", "softpipe", "gpu", "webgl"] = "llvmpipe"
    """What draws: Mesa's drivers, the system's own, or headless Chromium."""
    shaders: Path | None = None
    """Folder whose shaders take the place of those of the same names."""
    output: Path = Path("impostor_parity")
    """Folder that the table and the pictures are written to."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from impostor_jax.parity.cases import select
        from impostor_jax.parity.report import write_parity
        from impostor_jax.parity.run import open_renderer, run_parity

        check_output_folder(self.output, ("parity.json", "parity.md"))
        chosen, done = select(self.camera, self.cases), []
        with open_renderer(self.driver, self.shaders) as renderer:
            print(f"{renderer.name}, {len(chosen)} cases")
            for row in run_parity(chosen, renderer):
                done.append(row)
                for verdict in row.verdicts:
                    if not verdict.holds:
                        print(
                            f"{row.case.name}: {verdict.quantity} is "
                            f"{verdict.value:.3g}, at most {verdict.bound:.3g} expected"
                        )
        write_parity(self.output, renderer.name, done)
        broken = sum(not row.holds for row in done)
        print(
            f"parity holds in {len(done) - broken} of {len(done)} cases; see "
            f"{self.output / 'parity.md'}"
        )
        return 1 if broken else 0
