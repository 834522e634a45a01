"""Serves a network of the package ``stereo-matching`` from PyPI to Icy Moon, in the Python that has the package.

    PYTHON run_stereo_matching.py MODEL [--checkpoint FILE] [--height PX] [--device DEVICE]

Icy Moon's matcher ``stereo_matching`` starts it.
"""

from __future__ import annotations

import argparse
import functools
import sys
from typing import Any

import numpy as np


def main() -> None:
    """Load the network and answer pairs."""
    from icymoon_serve import serve  # from the folder of this file

    parser = argparse.ArgumentParser()
    parser.add_argument("model")
    parser.add_argument("--checkpoint")
    parser.add_argument("--height", type=int)
    parser.add_argument("--device")
    options = parser.parse_args()
    try:
        _refuse_pickles()
        network = _load_pipeline(options)
    except Exception as error:
        sys.exit(f"{type(error).__name__}: {' '.join(str(error).split())}")
    if options.height:
        network.processor.input_size = options.height
    size: list[int] = []

    def disparity(left: np.ndarray, right: np.ndarray, camera: object) -> np.ndarray:
        found = network(left, right, colorize=False)
        size[:] = found.metadata.get("input_resolution", ())
        return np.asarray(found.disparity)

    serve(disparity, options.model, lambda: {"input_height": size[0], "input_width": size[1]} if size else {})


def _refuse_pickles() -> None:
    """Restrict the reading of checkpoints to data.

    If a checkpoint contains more than parameters, the package reads it again with ``weights_only=False``, which runs
    code in the file.
    """
    import torch

    load = torch.load

    @functools.wraps(load)
    def load_parameters(*arguments: object, **options: object) -> object:
        if options.get("weights_only") is False:
            raise RuntimeError(
                f"{arguments[0] if arguments else 'the checkpoint'} contains more than parameters, "
                "which may be code, so it is not loaded; save only its parameters: "
                "torch.save(model.state_dict(), FILE)"
            )
        return load(*arguments, **{**options, "weights_only": True})

    torch.load = load_parameters


def _load_pipeline(options: argparse.Namespace) -> Any:
    import stereo_matching

    if not options.checkpoint:
        return stereo_matching.pipeline("stereo-matching", model=options.model, device=options.device)
    known = stereo_matching.MODEL_REGISTRY
    config = known.get_config_cls(options.model).from_variant(options.model)
    model = known.get_model_cls(options.model).from_pretrained(
        options.checkpoint, device=options.device, variant=config.variant
    )
    processor = stereo_matching.StereoProcessor.from_config(config)
    return stereo_matching.StereoPipeline(model=model, processor=processor, device=options.device)


if __name__ == "__main__":
    main()
