"""Packages: ``templates/`` stands at the top of the repository and is ``padgen/templates`` in a wheel."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["padgen*"]), "padgen.templates"],
    package_dir={"padgen.templates": "templates"},
)
