"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import table
from experiments.recording import Results

DERIVATIVES = ("depth.radius", "depth.height", "depth.axis", "coverage.radius")


def tables(results: Results) -> str:
    """Parts of the image, derivatives, fits, and sizes of the pictures."""
    values = results.values
    seen = [
        [case.split(".")[1], f"{100 * values[f'{case}.seen']:.1f} %"]
        for case in results.cases("", ".seen")
    ]
    worst = [
        [name.replace(".", " in "), f"{values[f'gradients.{name}.worst']:.1e}"]
        for name in DERIVATIVES
    ]
    found = []
    for key in results.cases("fits.", ""):
        (value, spread), name = results.pair(key), " ".join(key.split(".")[1:])
        if key == "fits.size":
            continue
        if key.endswith(".p_value"):
            found.append([name, f"{value:.2g}"])
        elif spread is None:
            found.append([name, f"{1e3 * value:.2f} mm"])
        else:
            found.append([name, f"{1e3 * value:.3f} mm (std {1e3 * spread:.3f})"])
    sizes = [
        [picture, f"{values[f'{picture}.size'] / 1000:.0f}"]
        for picture in results.cases("", ".size")
    ]
    return "\n\n".join(
        (
            table(["shape", "part of the image"], seen),
            table(["derivative", "largest deviation from differences"], worst),
            table(["fit", "found"], found),
            table(["picture", "kB"], sizes),
        )
    )
