"""Builds the filter's kernel when there is a C compiler; without one the install goes on and Python runs it."""

from setuptools import setup

setup()
