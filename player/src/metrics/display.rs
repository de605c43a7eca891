//! What the tonemap pass does, on the CPU: `shaders/common/tonemap.glsl` in f32, without its dithering.

use super::Picture;
use crate::settings::{Settings, Tonemap};

/// Debug views from this one on show values as they are.
const FIRST_PASSTHROUGH_VIEW: u32 = 4;

/// Linear radiance to linear display values in 0..=1.
pub fn display(radiance: &Picture, settings: &Settings) -> Picture {
    if settings.debug_view >= FIRST_PASSTHROUGH_VIEW {
        return radiance.map(|texel| texel.map(|value| value.clamp(0.0, 1.0)));
    }
    let exposure = settings.ev.exp2();
    radiance.map(|texel| {
        let exposed = texel.map(|value| value * exposure);
        curve(exposed, settings.tonemap).map(|value| value.clamp(0.0, 1.0))
    })
}

fn curve(color: [f32; 3], tonemap: Tonemap) -> [f32; 3] {
    match tonemap {
        Tonemap::Aces => color.map(|x| (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)),
        Tonemap::Linear => color,
        Tonemap::Agx => agx(color),
        Tonemap::Neutral => neutral(color),
    }
}

/// Columns, as GLSL has them.
type Matrix = [[f32; 3]; 3];

fn multiply(columns: &Matrix, color: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|row| {
        (0..3)
            .map(|column| columns[column][row] * color[column])
            .sum()
    })
}

fn agx(color: [f32; 3]) -> [f32; 3] {
    const INSET: Matrix = [
        [0.842_401_1, 0.042_401_07, 0.042_401_07],
        [0.078_436_5, 0.878_436_6, 0.078_436_5],
        [0.079_162_43, 0.079_162_43, 0.879_162_4],
    ];
    const OUTSET: Matrix = [
        [1.196_998_7, -0.053_001_34, -0.053_001_34],
        [-0.098_045_63, 1.151_954_4, -0.098_045_63],
        [-0.098_953_03, -0.098_953_03, 1.151_047],
    ];
    let stops = multiply(&INSET, color).map(|value| value.max(1e-10).log2());
    let encoded = stops.map(|stop| agx_sigmoid(((stop + 12.473_931) / 16.5).clamp(0.0, 1.0)));
    multiply(&OUTSET, encoded).map(|value| value.max(0.0).powf(2.2))
}

fn agx_sigmoid(x: f32) -> f32 {
    const PIVOT: f32 = 20.0 / 33.0;
    let distance = (x - PIVOT).abs();
    let slope = if x < PIVOT {
        (1.0 + 59.507_874 * distance.powi(3)).powf(-1.0 / 3.0)
    } else {
        (1.0 + 69.862_79 * distance.powf(3.25)).powf(-4.0 / 13.0)
    };
    0.5 + 2.0 * (x - PIVOT) * slope
}

fn neutral(color: [f32; 3]) -> [f32; 3] {
    const START: f32 = 0.8 - 0.04;
    let least = color[0].min(color[1]).min(color[2]);
    let fresnel = if least < 0.08 {
        least - 6.25 * least * least
    } else {
        0.04
    };
    let color = color.map(|value| value - fresnel);
    let peak = color[0].max(color[1]).max(color[2]);
    if peak < START {
        return color;
    }
    let room = 1.0 - START;
    let shown = 1.0 - room * room / (peak + room - START);
    let white = 1.0 - 1.0 / (0.15 * (peak - shown) + 1.0);
    color.map(|value| value * (shown / peak) * (1.0 - white) + shown * white)
}
