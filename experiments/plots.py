"""What figures of several experiments have in common."""

__all__ = ["bars"]

from collections.abc import Callable, Mapping

from matplotlib.axes import Axes

from experiments.markdown import three_digits
from experiments.recording import Results


def bars(
    axes: Axes,
    results: Results,
    labels: Mapping[str, str],
    color: Callable[[str], str],
) -> list[str]:
    """Draw a median in ms as a bar, for each metric that was measured.

    Whiskers are as wide as the spread.

    Args:
        axes: Where to; with a logarithmic scale.
        results: Of the experiment.
        labels: By the names of the metrics.
        color: Of a metric.

    Returns:
        The metrics from the top bar to the lowest.
    """
    shown = [name for name in labels if results.values.get(name) is not None]
    for row, name in enumerate(shown):
        median, spread = results.pair(name)
        whiskers = {"xerr": spread / 2, "error_kw": {"capsize": 2}}
        axes.barh(row, median, color=color(name), **whiskers)
        where = 1.15 * (median + spread / 2)
        axes.text(where, row, f"{three_digits(median)} ms", va="center", fontsize=8)
    axes.set_yticks(range(len(shown)), [labels[name] for name in shown], fontsize=8)
    axes.set_xscale("log")
    axes.margins(x=0.15)
    axes.invert_yaxis()
    return shown
