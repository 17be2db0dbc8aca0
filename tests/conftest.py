"""Shared fixtures: both precisions, strict promotion, one cache of compiled code."""

import gc
import os
from pathlib import Path

import pytest

CACHE = Path(__file__).parent.parent / ".pytest_cache" / "jax"
# Compile time rules the suite; the command-line tests' processes share the cache too.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(CACHE))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.05")
# Threads of two processes on two cores wait for each other: an inverse of 144 x 144
# took 150 ms for 0.5, and a calibration 15 s for 0.7.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis  # noqa: E402
import jax  # noqa: E402
import numpy as np  # noqa: E402

MOST_REGIONS = 30_000
"""Of memory, that a process may take. Every compiled program takes several of the
65,530 that Linux allows, and XLA crashes where it gets none."""

ONE_GENERATOR = (0, 11, 1)
"""Version of JAX from which on XLA has one generator of code for fusions."""

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

# Compilation makes a first example slow, and the examples are the same in every run.
hypothesis.settings.register_profile(
    "fixed", deadline=None, derandomize=True, database=None, max_examples=50
)
hypothesis.settings.load_profile("fixed")


def pytest_addoption(parser):
    parser.addoption(
        "--full", action="store_true", help="run what CI runs: long tests, too"
    )
    parser.addoption(
        "--release",
        action="store_true",
        help="run all: what takes too long for CI, too",
    )
    parser.addoption(
        "--optimized", action="store_true", help="let XLA optimize as users' runs do"
    )


def pytest_configure(config):
    """Let XLA compile quickly, which takes most of the time, before it compiles at all.

    Its newer code generator for fusions takes twice the time of the older one, where
    there are two, and optimizations as long as all else. Without either, results are
    now and then rounded in another way: so what is promised of rounding errors is
    tested with `tests.checks.AS_USERS_RUN`, and with --optimized, which takes a fit's
    tests 1.6 times as long, XLA optimizes all.
    """
    flags = []
    # A flag that XLA no longer has would end the process.
    if jax.__version_info__ < ONE_GENERATOR:
        flags.append("--xla_cpu_use_fusion_emitters=false")
        # Each process has one core, where parts of a program gain nothing.
        flags.append("--xla_cpu_parallel_codegen_split_count=1")
    if not config.getoption("--optimized"):
        flags.append("--xla_backend_optimization_level=0")
    os.environ.setdefault("XLA_FLAGS", " ".join(flags))


def pytest_collection_finish():
    """Look for unreachable objects seldom: of a million that stay, a quarter of the
    time that a suite with a filled cache took went into looking for a few."""
    gc.freeze()
    gc.set_threshold(100_000)


def pytest_runtest_teardown(item, nextitem):
    """Forget compiled programs before the system refuses room for more."""
    if nextitem is not None and nextitem.path != item.path:
        from impostor_jax.compiling import forget, memory_regions

        if memory_regions() > MOST_REGIONS:
            forget()


def pytest_sessionfinish():
    """Pytest looks for unreachable objects five times at the end."""
    gc.freeze()


@pytest.fixture(params=["float32", pytest.param("float64", marks=pytest.mark.full)])
def dtype(request):
    """Default floating-point type of the test; double precision with --full alone."""
    with jax.enable_x64(request.param == "float64"):
        yield np.dtype(request.param)


@pytest.fixture
def double():
    """The test runs in double precision."""
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module")
def browser():
    """Headless Chromium, which draws; one for the tests of a module."""
    from impostor_jax.glsl.offscreen import DriverError
    from impostor_jax.glsl.webgl import WebglRenderer

    try:
        found = WebglRenderer()
    except DriverError as error:
        pytest.skip(str(error))
    with found:
        yield found


@pytest.fixture
def opened(browser, tmp_path):
    """Opens a page in a window, by default of 64x48, and notes what it complains of."""
    pages = []

    def open_page(text, before="", size=(64, 48), **options):
        viewport = {"width": size[0], "height": size[1]}
        page = browser._page.context.browser.new_page(viewport=viewport, **options)
        pages.append(page)
        path = tmp_path / "page.html"
        path.write_text(text)
        page.add_init_script(before)
        page.complaints, page.asked = [], []
        page.on("console", lambda message: page.complaints.append(message.text))
        page.on("pageerror", lambda error: page.complaints.append(str(error)))
        page.on("request", lambda request: page.asked.append(request.url))
        page.goto(path.as_uri())
        return page

    yield open_page
    for page in pages:
        page.close()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """A process takes a whole file, or what `tests.groups` keeps together: first.

    What is marked as in `tests.groups` is left to an option.
    """
    asked = {"release": config.getoption("--release")}
    asked["full"] = asked["release"] or config.getoption("--full")
    left_out = [mark for mark, is_asked in asked.items() if not is_asked]
    later = {item for item in items if any(map(item.get_closest_marker, left_out))}
    config.hook.pytest_deselected(items=[item for item in items if item in later])
    items[:] = [item for item in items if item not in later]

    def is_grouped(item):
        return item.get_closest_marker("xdist_group") is not None

    items.sort(key=lambda item: not is_grouped(item))
    for item in items:
        if not is_grouped(item):
            item.add_marker(pytest.mark.xdist_group(item.nodeid.split("::")[0]))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """With IMPOSTOR_REQUIRE_ALL=1 a skipped test is a failure."""
    outcome = yield
    report = outcome.get_result()
    if report.skipped and os.environ.get("IMPOSTOR_REQUIRE_ALL") == "1":
        report.outcome = "failed"
        report.longrepr = f"skipped with IMPOSTOR_REQUIRE_ALL=1: {report.longrepr}"
