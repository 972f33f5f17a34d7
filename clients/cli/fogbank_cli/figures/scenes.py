"""Where the figures' scenes are."""

from __future__ import annotations

from pathlib import Path

# clients/cli/fogbank_cli/figures/scenes.py -> the checkout; a wheel has no scenes, and --scene is needed.
CHECKOUT = Path(__file__).resolve().parents[4]
SCENES = CHECKOUT / "scenes"
FLATLAND = SCENES / "flatland"
