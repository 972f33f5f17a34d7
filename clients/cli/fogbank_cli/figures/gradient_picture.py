"""The picture of gradients in flatland: orientation, magnitude and error of each method."""

from __future__ import annotations

from pathlib import Path

import fogbank
import matplotlib as mpl
import numpy as np
from fogbank.flatland import FlatlandEstimates, FlatlandScene
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from fogbank_cli.figures.gradient_errors import PICTURED, Experiment, box_of, grid

Pixels = NDArray[np.float64]

# Gradients shorter than this share of the reference (the 97th percentile of exact magnitudes) fade to black: their
# direction is not seen in an image.
_FADING = 0.02
_ARROWS_A_SIDE = 16
_ARROW_COLOR = "#202020"
_PANEL_INCHES = 3.4
_ERROR_RANGE = (1e-4, 1.0)
_EXACT_TITLE = "exact"


def draw(
    service: fogbank.Service, scene: FlatlandScene, experiment: Experiment, resolution: int, samples: int, path: Path
) -> None:
    """Computes and writes the picture: a column per method, the exact answer first."""
    points = grid(scene, resolution)
    shown = {
        _EXACT_TITLE: service.probe_flatland(scene, points, method="exact", order=experiment.order),
    }
    for place in PICTURED:
        variant = experiment.variants[place]
        shown[variant.label] = service.probe_flatland(
            scene, points, method=variant.method, order=experiment.order, **experiment.options(variant, samples)
        )
    with mpl.rc_context({"font.size": 10, "image.origin": "lower", "image.interpolation": "nearest"}):
        figure = _compose(scene, shown, resolution)
        figure.suptitle(
            f"Gradient of the mean radiance, {experiment.order} scattering, {samples} directions a point",
            fontsize=13,
            y=0.985,
        )
        figure.savefig(path, dpi=110)


def _compose(scene: FlatlandScene, shown: dict[str, FlatlandEstimates], resolution: int) -> Figure:
    low, high = box_of(scene)
    extent = (float(low[0]), float(high[0]), float(low[1]), float(high[1]))
    width, height = _PANEL_INCHES, _PANEL_INCHES * (extent[3] - extent[2]) / (extent[1] - extent[0])
    figure = Figure(figsize=(len(shown) * width + 1.7, 3 * height + 1.3))
    # The last column is for the legends.
    layout = figure.add_gridspec(
        3,
        len(shown) + 1,
        width_ratios=[*[1] * len(shown), 0.05],
        left=0.3 / figure.get_figwidth(),
        right=1 - 0.95 / figure.get_figwidth(),
        bottom=0.1 / figure.get_figheight(),
        top=1 - 0.9 / figure.get_figheight(),
        wspace=0.05,
        hspace=0.05,
    )
    exact = shown[_EXACT_TITLE]
    reference = float(np.percentile(np.linalg.norm(exact.gradient, axis=1), 97)) or 1.0

    def image(values: Pixels) -> Pixels:
        return values.reshape(resolution, resolution, *values.shape[1:])

    def shade(panel: Axes, values: Pixels, colors: str, smallest: float, largest: float) -> AxesImage:
        # The colour scale is logarithmic and has no place for 0.
        positive = np.maximum(image(values), 1e-300)
        return panel.imshow(positive, extent=extent, cmap=colors, norm=LogNorm(smallest, largest))

    for column, (title, estimates) in enumerate(shown.items()):
        orientation, magnitude, bottom = (figure.add_subplot(layout[row, column]) for row in range(3))
        lengths = np.linalg.norm(estimates.gradient, axis=1)
        brightness = np.clip(lengths / (_FADING * reference), 0, 1)
        orientation.set_title(title.replace("bisection, ", "bisection,\n"))
        orientation.imshow(image(_hues(estimates.gradient) * brightness[:, None]), extent=extent)
        _add_arrows(orientation, image(estimates.gradient), extent, _FADING * reference)
        magnitudes = shade(magnitude, lengths, "inferno", reference / 300, reference * 3)
        if column == 0:
            brightest = float(np.percentile(exact.radiance, 99.5)) or 1.0
            shade(bottom, exact.radiance, "gray", brightest / 1000, brightest)
            for panel, label in (
                (orientation, "orientation"),
                (magnitude, "magnitude"),
                (bottom, "radiance (exact), logarithmic"),
            ):
                panel.set_ylabel(label)
        else:
            error = np.linalg.norm(estimates.gradient - exact.gradient, axis=1) / reference
            errors = shade(bottom, error, "viridis", *_ERROR_RANGE)
        for panel in (orientation, magnitude, bottom):
            _add_segments(panel, scene)
            panel.set(xticks=[], yticks=[], xlim=extent[:2], ylim=extent[2:])
    _add_wheel(figure.add_subplot(layout[0, -1]))
    for row, shades, label in (
        (1, magnitudes, "magnitude per unit"),
        (2, errors, "error / 97th percentile"),
    ):
        figure.colorbar(shades, cax=figure.add_subplot(layout[row, -1]), extend="both", label=label)
    return figure


def _hues(vectors: Pixels) -> Pixels:
    """Linear position on a circle of equal lightness and chroma (Ottosson 2020, "A perceptual color space: Oklab")."""
    angle = np.arctan2(vectors[:, 1], vectors[:, 0])
    lightness, chroma = 0.73, 0.14
    a, b = chroma * np.cos(angle), chroma * np.sin(angle)
    cones = np.stack(
        [
            lightness + 0.3963377774 * a + 0.2158037573 * b,
            lightness - 0.1055613458 * a - 0.0638541728 * b,
            lightness - 0.0894841775 * a - 1.2914855480 * b,
        ],
        axis=-1,
    )
    to_linear = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return fogbank.to_srgb((cones**3 @ to_linear.T).astype(np.float32)).astype(np.float64) / 255.0


def _add_arrows(panel: Axes, gradient: Pixels, extent: tuple[float, ...], shortest: float) -> None:
    resolution = len(gradient)
    step = max(1, resolution // _ARROWS_A_SIDE)
    places = np.arange(step // 2, resolution, step)
    vectors = gradient[np.ix_(places, places)]
    lengths = np.linalg.norm(vectors, axis=-1)
    x = extent[0] + (places + 0.5) / resolution * (extent[1] - extent[0])
    y = extent[2] + (places + 0.5) / resolution * (extent[3] - extent[2])
    x, y = np.meshgrid(x, y)
    seen = lengths > shortest
    units = vectors[seen] / lengths[seen, None]
    panel.quiver(
        x[seen],
        y[seen],
        units[:, 0],
        units[:, 1],
        scale=_ARROWS_A_SIDE * 1.6,
        width=0.0045,
        color=_ARROW_COLOR,
        pivot="mid",
    )


def _add_segments(panel: Axes, scene: FlatlandScene) -> None:
    for segment in scene.segments:
        x, y = (segment.start.x, segment.end.x), (segment.start.y, segment.end.y)
        panel.plot(x, y, color="black", linewidth=5, solid_capstyle="butt")
        panel.plot(x, y, color="#ffe680" if segment.radiance > 0 else "white", linewidth=2.5, solid_capstyle="butt")


def _add_wheel(place: Axes) -> None:
    """The legend of orientations."""
    place.axis("off")
    wheel = place.inset_axes((0.0, 0.36, 5.2, 0.28))
    side = np.linspace(-1, 1, 160)
    x, y = np.meshgrid(side, side)
    distance = np.hypot(x, y)
    alpha = ((distance > 0.4) & (distance < 1)).astype(float)
    hues = _hues(np.stack([x.ravel(), y.ravel()], axis=-1)).reshape(*x.shape, 3)
    wheel.imshow(np.concatenate([hues, alpha[..., None]], axis=-1), extent=(-1, 1, -1, 1))
    for angle in np.arange(0, 2 * np.pi, np.pi / 4):
        x_part, y_part = float(np.cos(angle)), float(np.sin(angle))
        wheel.annotate(
            "",
            xy=(0.98 * x_part, 0.98 * y_part),
            xytext=(0.42 * x_part, 0.42 * y_part),
            arrowprops={"arrowstyle": "->", "color": _ARROW_COLOR},
        )
    wheel.axis("off")
