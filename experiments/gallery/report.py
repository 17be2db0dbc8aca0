"""The tables of the README from results.json."""

__all__ = ["tables"]

from pathlib import Path

from experiments.recording import read_spreads, read_values

DERIVATIVES = ("depth.radius", "depth.height", "depth.axis", "coverage.radius")


def tables(folder: Path) -> str:
    """Results of a folder in Markdown."""
    values, spreads = read_values(folder), read_spreads(folder)
    lines = ["| shape | part of the image |", "|---|--:|"]
    for key, value in values.items():
        if key.endswith(".seen"):
            lines.append(f"| {key.split('.')[1]} | {100 * value:.1f} % |")
    lines += ["", "| derivative | largest deviation from differences |", "|---|--:|"]
    for name in DERIVATIVES:
        value = values[f"gradients.{name}.worst"]
        lines.append(f"| {name.replace('.', ' in ')} | {value:.1e} |")
    lines += ["", "| fit | found |", "|---|--:|"]
    for key, (value, spread) in spreads.items():
        if not key.startswith("fits.") or key == "fits.size" or value is None:
            continue
        name = " ".join(key.split(".")[1:])
        if key.endswith(".p_value"):
            lines.append(f"| {name} | {value:.2g} |")
        elif spread is None:
            lines.append(f"| {name} | {1e3 * value:.2f} mm |")
        else:
            std = f"{1e3 * value:.3f} mm (std {1e3 * spread:.3f})"
            lines.append(f"| {name} | {std} |")
    lines += ["", "| picture | kB |", "|---|--:|"]
    for key, value in values.items():
        if key.endswith(".size"):
            lines.append(f"| {key.split('.')[0]} | {value / 1000:.0f} |")
    return "\n".join(lines)
