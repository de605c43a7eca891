//! How far one picture is from another: RMSE, mean relative error, FLIP, and pictures of the difference.

pub mod color;
pub mod display;
pub mod flip;
pub mod heatmap;
#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicUsize, Ordering};

/// Linear RGB, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Texels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major.
    pub texels: Vec<[f32; 3]>,
}

/// Two pictures of different sizes cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the pictures have different sizes: {0}x{1} and {2}x{3}")]
pub struct SizeMismatch(pub usize, pub usize, pub usize, pub usize);

/// Distances of a picture from a reference.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Difference {
    /// Root of the mean squared difference over texels and channels, in the pictures' units.
    pub rmse: f64,
    /// Mean over texels and channels of `|test - reference| / (reference + 0.01)`, the reference not below 0.
    pub relative: f64,
    /// Mean test minus mean reference, over the mean reference; 0 where that is 0.
    pub bias: f64,
}

/// Keeps the relative error of black finite: a hundredth of white.
const RELATIVE_FLOOR: f64 = 0.01;

impl Picture {
    /// From rows of linear RGB with anything in the fourth channel.
    ///
    /// # Panics
    /// Where there are not `width * height` texels.
    pub fn from_rgba(width: usize, height: usize, texels: &[[f32; 4]]) -> Self {
        assert_eq!(texels.len(), width * height);
        let texels = texels.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        Self {
            width,
            height,
            texels,
        }
    }

    /// From rows of sRGB-encoded RGBA.
    ///
    /// # Panics
    /// Where there are not `width * height * 4` bytes.
    pub fn from_srgb8(width: usize, height: usize, rgba8: &[u8]) -> Self {
        assert_eq!(rgba8.len(), width * height * 4);
        let linear: Vec<f32> = (0..=255)
            .map(|value| color::srgb_to_linear(value as f32 / 255.0))
            .collect();
        let texel = |texel: &[u8]| [0, 1, 2].map(|channel| linear[usize::from(texel[channel])]);
        let texels = rgba8.chunks_exact(4).map(texel).collect();
        Self {
            width,
            height,
            texels,
        }
    }

    /// sRGB-encoded RGBA, opaque, of a picture in 0..=1; what lies outside is clamped.
    pub fn to_srgb8(&self) -> Vec<u8> {
        let encode =
            |value: &f32| (color::linear_to_srgb(value.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
        let bytes = |[r, g, b]: &[f32; 3]| [encode(r), encode(g), encode(b), 255];
        self.texels.iter().flat_map(bytes).collect()
    }

    /// Each texel through `function`.
    pub fn map(&self, function: impl Fn([f32; 3]) -> [f32; 3]) -> Self {
        let texels = self.texels.iter().map(|texel| function(*texel)).collect();
        Self { texels, ..*self }
    }

    /// Whether all channels are finite.
    pub fn is_finite(&self) -> bool {
        self.texels.iter().flatten().all(|value| value.is_finite())
    }

    fn check_size(&self, other: &Self) -> Result<(), SizeMismatch> {
        if (self.width, self.height) == (other.width, other.height) {
            return Ok(());
        }
        Err(SizeMismatch(
            self.width,
            self.height,
            other.width,
            other.height,
        ))
    }
}

/// Distances of `test` from `reference`, both linear.
///
/// # Errors
/// [`SizeMismatch`].
pub fn difference(test: &Picture, reference: &Picture) -> Result<Difference, SizeMismatch> {
    test.check_size(reference)?;
    let (mut squares, mut relative, mut means) = (0.0, 0.0, [0.0; 2]);
    let pairs = test
        .texels
        .iter()
        .flatten()
        .zip(reference.texels.iter().flatten());
    for (a, b) in pairs {
        let (a, b) = (f64::from(*a), f64::from(*b));
        squares += (a - b) * (a - b);
        relative += (a - b).abs() / (b.max(0.0) + RELATIVE_FLOOR);
        means[0] += a;
        means[1] += b;
    }
    let count = (test.texels.len() * 3).max(1) as f64;
    Ok(Difference {
        rmse: (squares / count).sqrt(),
        relative: relative / count,
        bias: if means[1] == 0.0 {
            0.0
        } else {
            (means[0] - means[1]) / means[1]
        },
    })
}

/// `test - reference` around middle grey, `gain` times.
///
/// # Errors
/// [`SizeMismatch`].
pub fn signed_difference(
    test: &Picture,
    reference: &Picture,
    gain: f32,
) -> Result<Picture, SizeMismatch> {
    test.check_size(reference)?;
    let pairs = test.texels.iter().zip(&reference.texels);
    let texel = |(a, b): (&[f32; 3], &[f32; 3])| {
        std::array::from_fn(|channel| color::srgb_to_linear(0.5) + gain * (a[channel] - b[channel]))
    };
    let texels = pairs.map(texel).collect();
    Ok(Picture { texels, ..*test })
}

/// Fills `output` by calling `row(y, its texels)` on every core.
fn by_rows<T: Send>(output: &mut [T], width: usize, row: impl Fn(usize, &mut [T]) + Sync) {
    if output.is_empty() {
        return;
    }
    let threads = std::thread::available_parallelism().map_or(1, |count| count.get());
    let rows: Vec<_> = output
        .chunks_mut(width)
        .map(|row| std::sync::Mutex::new(Some(row)))
        .collect();
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads.min(rows.len()) {
            scope.spawn(|| {
                loop {
                    let y = next.fetch_add(1, Ordering::Relaxed);
                    let Some(slot) = rows.get(y) else { return };
                    let taken = slot.lock().map(|mut slot| slot.take());
                    if let Ok(Some(texels)) = taken {
                        row(y, texels);
                    }
                }
            });
        }
    });
}
