"""OpenCV is one of its four distributions, whole; another state is told."""

import re
import runpy
import sys
import types
from pathlib import Path

import pytest

from impostor_jax import opencv
from impostor_jax.cli.doctor_command import _opencv

PACKAGE = Path(opencv.__file__).parent
# Windows, which the headless ones lack, and modules that contrib alone has.
NOT_IN_ALL = set(
    """
    imshow waitKey namedWindow destroyAllWindows destroyWindow createTrackbar
    setMouseCallback selectROI bgsegm bioinspired ccm dpm face freetype ft hfs
    img_hash intensity_transform kinfu large_kinfu legacy line_descriptor linemod mcc
    motempl omnidir optflow phase_unwrapping plot ppf_match_3d quality rapid reg rgbd
    saliency stereo structured_light text tracking videostab wechat_qrcode xfeatures2d
    ximgproc xphoto
    """.split()
)


def test_nothing_is_used_that_a_distribution_lacks():
    for folder in (PACKAGE, PACKAGE.parent / "data_synth"):
        for path in folder.rglob("*.py"):
            used = set(re.findall(r"\bcv2\.(\w+)", path.read_text()))
            assert not used & NOT_IN_ALL, path


@pytest.mark.parametrize("left", [types.ModuleType("cv2"), None], ids=["empty", "none"])
def test_an_import_that_fails_says_how_to_mend_it(left, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", left)
    with pytest.raises(ImportError, match=r"must be whole, got: .*cv2.*pip install"):
        runpy.run_path(opencv.__file__)


def test_two_distributions_are_named_with_what_removes_both(monkeypatch):
    two = {"opencv-contrib-python-headless": "5.0", "opencv-python": "4.11"}
    monkeypatch.setattr(opencv, "distributions", lambda: two)
    told = _opencv()
    assert f"there is {', '.join(map(' '.join, two.items()))}; run" in told
    assert f"pip uninstall --yes {' '.join(two)}, then: pip install" in told
