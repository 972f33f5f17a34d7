"""Where the figures' scenes are."""

from __future__ import annotations

import os
from pathlib import Path

# clients/cli/fogbank_cli/figures/scenes.py -> the checkout; a wheel has no scenes, and --scene is needed.
CHECKOUT = Path(__file__).resolve().parents[4]
SCENES = CHECKOUT / "scenes"
FLATLAND = SCENES / "flatland"

# Scenes that nobody here wrote lie beside the checkout.
SHARED = Path(os.environ.get("FOGBANK_SHARED", CHECKOUT.parent / "shared"))
