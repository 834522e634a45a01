"""The evaluator's verbs ``evaluate``, ``decide``, ``fuse`` and ``design``; the first three have a default folder."""

from __future__ import annotations

import argparse

from ..stereo import cli as stereo


def add_evaluate_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``evaluate``."""
    stereo.add_evaluate_options(parser, out_needed=False)
    parser.set_defaults(run=_run_evaluate)


def add_decide_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``decide``."""
    stereo.add_decide_options(parser, out_needed=False)
    parser.set_defaults(run=_run_decide)


def add_fuse_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``fuse``."""
    stereo.add_fuse_options(parser, out_needed=False)
    parser.set_defaults(run=_run_fuse)


def add_design_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``design``."""
    stereo.add_design_options(parser)
    parser.set_defaults(run=stereo.run_design)


def _run_evaluate(options: argparse.Namespace) -> int:
    options.out = options.out or options.path[0] / "evaluation"
    return stereo.run_evaluate(options)


def _run_decide(options: argparse.Namespace) -> int:
    options.out = options.out or options.path[0] / "decisions"
    return stereo.run_decide(options)


def _run_fuse(options: argparse.Namespace) -> int:
    options.out = options.out or options.path[0] / "fusion"
    return stereo.run_fuse(options)
