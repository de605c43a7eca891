//! Colour under zero alpha, taken from its surroundings.
//!
//! What is stored where nothing is seen still shows at borders: a bilinear read mixes it in. A pyramid of
//! alpha-weighted means is built until no texel is without colour, and then read back from the coarsest level (pull
//! and push; Gortler et al., "The Lumigraph", 1996, section 3.4).

use rayon::prelude::*;

use super::mips::Plane;

/// Gives colour to the texels without alpha; whether any was changed. Images without any alpha stay as they are.
pub(super) fn bleed(plane: &mut Plane) -> bool {
    let hollow = |plane: &Plane| plane.texels.par_iter().any(|texel| texel[3] <= 0.0);
    if !hollow(plane) || plane.texels.par_iter().all(|texel| texel[3] <= 0.0) {
        return false;
    }
    let mut coarser: Vec<Plane> = vec![pull(plane)];
    while let Some(last) = coarser.last().filter(|last| hollow(last)) {
        let next = pull(last);
        coarser.push(next);
    }
    while let Some(coarse) = coarser.pop() {
        push(coarser.last_mut().unwrap_or(plane), &coarse);
    }
    true
}

/// Means of 2x2 texels, rounded up in size: colour weighted by alpha, alpha the mean of those inside.
fn pull(plane: &Plane) -> Plane {
    let (width, height) = (plane.width.div_ceil(2), plane.height.div_ceil(2));
    let mut texels = vec![[0.0_f32; 4]; width as usize * height as usize];
    let rows = plane.texels.par_chunks(2 * plane.width as usize);
    texels
        .par_chunks_mut(width as usize)
        .zip(rows)
        .for_each(|(out, rows)| {
            for (x, out) in out.iter_mut().enumerate() {
                let (mut sum, mut count) = ([0.0_f32; 4], 0.0);
                for row in rows.chunks(plane.width as usize) {
                    for &[r, g, b, alpha] in row.iter().skip(2 * x).take(2) {
                        for (sum, value) in sum.iter_mut().zip([r * alpha, g * alpha, b * alpha]) {
                            *sum += value;
                        }
                        sum[3] += alpha;
                        count += 1.0;
                    }
                }
                let [r, g, b, alpha] = sum;
                if alpha > 0.0 {
                    *out = [r / alpha, g / alpha, b / alpha, alpha / count];
                }
            }
        });
    Plane {
        width,
        height,
        texels,
    }
}

/// Fills the texels without alpha from the level below, bilinearly; their alpha stays zero.
fn push(plane: &mut Plane, coarse: &Plane) {
    let width = plane.width as usize;
    let rows = plane.texels.par_chunks_mut(width).enumerate();
    rows.for_each(|(y, row)| {
        for (x, texel) in row.iter_mut().enumerate() {
            if texel[3] <= 0.0 {
                let [r, g, b] = between(coarse, x, y);
                *texel = [r, g, b, 0.0];
            }
        }
    });
}

/// The colour that a bilinear read of `coarse` gives at texel `x`, `y` of the level of twice the size, edges clamped.
fn between(coarse: &Plane, x: usize, y: usize) -> [f32; 3] {
    let axis = |at: usize, extent: u32| {
        let near = at / 2;
        let far = if at % 2 == 1 {
            near + 1
        } else {
            near.saturating_sub(1)
        };
        [near, far.min(extent as usize - 1)]
    };
    let (columns, rows) = (axis(x, coarse.width), axis(y, coarse.height));
    let mut color = [0.0; 3];
    for (row, down) in rows.into_iter().zip([0.75, 0.25]) {
        for (column, across) in columns.into_iter().zip([0.75, 0.25]) {
            let texel = coarse.texels[row * coarse.width as usize + column];
            for (sum, value) in color.iter_mut().zip(texel) {
                *sum += down * across * value;
            }
        }
    }
    color
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; 4]) -> Plane {
        let texels = (0..width * height)
            .map(|index| texel(index % width, index / width))
            .collect();
        Plane {
            width,
            height,
            texels,
        }
    }

    #[test]
    fn holes_take_the_colour_around_them_and_nothing_else_changes() {
        for (width, height) in [(2, 1), (1, 9), (16, 16), (37, 22)] {
            let lone = |x, y| x == width / 2 && y == height / 2;
            let mut image = plane(width, height, |x, y| {
                if lone(x, y) {
                    [0.25, 0.5, 0.75, 0.5]
                } else {
                    [1.0, 0.0, 1.0, 0.0]
                }
            });
            assert!(bleed(&mut image));
            for (index, texel) in (0..).zip(&image.texels) {
                let alpha = if lone(index % width, index / width) {
                    0.5
                } else {
                    0.0
                };
                for (value, expected) in texel.iter().zip([0.25, 0.5, 0.75, alpha]) {
                    assert!(
                        (value - expected).abs() < 1e-6,
                        "{width}x{height}: {texel:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn near_colours_win() {
        let mut image = plane(64, 4, |x, _| match x {
            0..8 => [1.0, 0.0, 0.0, 1.0],
            56.. => [0.0, 1.0, 0.0, 1.0],
            _ => [0.0, 0.0, 1.0, 0.0],
        });
        assert!(bleed(&mut image));
        assert!(image.texels[10][0] > 0.9 && image.texels[10][1] < 0.1);
        assert!(image.texels[53][1] > 0.9 && image.texels[53][0] < 0.1);
        assert!(image.texels.iter().all(|texel| texel[2] == 0.0));
    }

    #[test]
    fn images_without_holes_or_without_alpha_stay() {
        for alpha in [0.0, 0.2, 1.0] {
            let image = plane(5, 3, |x, y| [x as f32, y as f32, 0.5, alpha]);
            let mut bled = image.clone();
            assert!(!bleed(&mut bled));
            assert_eq!(bled, image);
        }
    }
}
