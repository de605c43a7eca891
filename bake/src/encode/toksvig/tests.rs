//! Roughness that stands for bumps, on surfaces whose answer is known.

use super::*;
use crate::encode::tests::source;

const TOP: u16 = u16::MAX;

fn surface(normals: Source<'_>, factor: f32) -> Surface<'_> {
    Surface {
        normals,
        normal_scale: 1.0,
        data: None,
        data_levels: &[],
        factor,
    }
}

/// A normal of slopes `-x` and `-y` as a texel.
fn texel(x: f64, y: f64) -> [u16; 4] {
    let length = (x * x + y * y + 1.0).sqrt();
    let code = |value: f64| ((0.5 * value / length + 0.5) * 65535.0).round() as u16;
    [code(x), code(y), code(1.0), TOP]
}

/// Normally distributed slopes of a deviation along each axis, the same every time.
fn rough(size: u32, deviation: f64) -> Vec<[u16; 4]> {
    let mut state = 1_u64;
    let mut uniform = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    };
    (0..size * size)
        .map(|_| {
            let radius = deviation * (-2.0 * uniform().ln()).sqrt();
            let angle = std::f64::consts::TAU * uniform();
            texel(radius * angle.cos(), radius * angle.sin())
        })
        .collect()
}

fn roughness(widened: &Widened, level: usize) -> Vec<f64> {
    let texels = widened.levels[level].iter();
    texels.map(|texel| f64::from(texel[1]) / 65535.0).collect()
}

#[test]
fn flat_normals_change_nothing() {
    let flat = vec![[32768, 32768, TOP, TOP]; 16 * 16];
    let tilted = vec![texel(0.4, -0.2); 16 * 16];
    for (normals, factor) in [(&flat, 0.3), (&tilted, 0.3), (&tilted, 0.0)] {
        let widened = widen(&surface(source(16, 16, normals), factor), MipFilter::Kaiser);
        assert_eq!(widened.levels.len(), 5);
        for level in 0..5 {
            for got in roughness(&widened, level) {
                assert!((got - f64::from(factor)).abs() < 1e-5, "{factor}: {got}");
            }
        }
        assert!(
            widened
                .report
                .levels
                .iter()
                .all(|level| level.error_after < 1e-6)
        );
    }
}

/// Gaussian slopes under GGX are GGX of nearly twice their variance more.
#[test]
fn slopes_add_twice_their_variance_to_the_square_of_alpha() {
    for (deviation, factor) in [(0.05, 0.3), (0.15, 0.4), (0.15, 0.6)] {
        let normals = rough(64, deviation);
        let widened = widen(&surface(source(64, 64, &normals), factor), MipFilter::Box);
        let squared = f64::from(factor).powi(4) + 2.0 * deviation * deviation;
        let expected = squared.powf(0.25);
        let got = roughness(&widened, 6)[0];
        let (rise, wanted) = (got - f64::from(factor), expected - f64::from(factor));
        // The bound by height is a little lower than the spread, as GGX has longer tails.
        assert!(
            rise > 0.6 * wanted && rise < 1.05 * wanted,
            "{deviation} {factor}: {got} {expected}"
        );
        assert_eq!(
            roughness(&widened, 0)[0],
            (f64::from(factor) * 65535.0).round() / 65535.0
        );
        let level = widened.report.levels[6];
        assert!(level.error_after < 0.65 * level.error_before, "{level:?}");
    }
}

/// A few scratches on a mirror: their spread alone would make it dull all over.
#[test]
fn scratches_leave_a_mirror() {
    let mut normals = vec![texel(0.0, 0.0); 32 * 32];
    for row in normals.chunks_mut(32).step_by(8) {
        for (x, normal) in row.iter_mut().enumerate() {
            *normal = texel(0.0, if x % 2 == 0 { 0.8 } else { -0.8 });
        }
    }
    let widened = widen(&surface(source(32, 32, &normals), 0.1), MipFilter::Box);
    // An eighth of the surface has slopes of 0.8: the spread would give a roughness of 0.63.
    let got = roughness(&widened, 5)[0];
    assert!(got > 0.1 && got < 0.12, "{got}");
    let level = widened.report.levels[5];
    assert!(level.error_after <= level.error_before + 0.01, "{level:?}");
}

#[test]
fn normals_that_cancel_are_as_rough_as_can_be() {
    // Leaning almost into the surface, to both sides.
    let normals: Vec<[u16; 4]> = (0..64)
        .map(|index| texel(if index % 2 == 0 { 1e4 } else { -1e4 }, 0.0))
        .collect();
    let widened = widen(&surface(source(8, 8, &normals), 0.2), MipFilter::Box);
    for got in roughness(&widened, 3) {
        assert!(got > 0.99, "{got}");
    }
}

#[test]
fn the_scale_of_normals_counts() {
    let normals = rough(32, 0.1);
    let mut surface = surface(source(32, 32, &normals), 0.3);
    let full = roughness(&widen(&surface, MipFilter::Box), 5)[0];
    surface.normal_scale = 0.25;
    let less = roughness(&widen(&surface, MipFilter::Box), 5)[0];
    surface.normal_scale = -1.0;
    let turned = roughness(&widen(&surface, MipFilter::Box), 5)[0];
    assert!(
        less > 0.3 && less - 0.3 < 0.2 * (full - 0.3),
        "{less} {full}"
    );
    assert!((turned - full).abs() < 1e-4, "{turned} {full}");
}

#[test]
fn roughness_images_of_any_size_go_with_normals_of_any_other() {
    let data: Vec<[u16; 4]> = (0..12 * 6)
        .map(|index| [100, 20_000 + 100 * index as u16, 5000, TOP])
        .collect();
    for (size, expected) in [(32, [32, 32]), (5, [12, 6]), (8, [12, 8])] {
        let normals = rough(size, 0.1);
        let surface = Surface {
            data: Some(source(12, 6, &data)),
            ..surface(source(size, size, &normals), 0.9)
        };
        let widened = widen(&surface, MipFilter::Kaiser);
        assert_eq!([widened.width, widened.height], expected);
        assert_eq!(
            widened.levels[0].len(),
            (expected[0] * expected[1]) as usize
        );
        assert!(widened.levels.last().is_some_and(|level| level.len() == 1));
        for level in &widened.levels {
            for texel in level {
                assert!(
                    texel[1] >= 17_990 && texel[0].abs_diff(100) <= 1,
                    "{texel:?}"
                );
                assert!(texel[2].abs_diff(5000) <= 1 && texel[3] == TOP);
            }
        }
        let last = widened.report.levels.last().expect("levels");
        assert!(last.mean_rise > 0.0 && last.max_rise >= last.mean_rise);
    }
}

#[test]
fn given_levels_are_kept() {
    let normals = vec![texel(0.0, 0.0); 16];
    let data = vec![[0, 30_000, 0, TOP]; 16];
    let given = [vec![[0, 40_000, 0, TOP]; 4], vec![[0, 50_000, 0, TOP]; 1]];
    let surface = Surface {
        data: Some(source(4, 4, &data)),
        data_levels: &given,
        ..surface(source(4, 4, &normals), 1.0)
    };
    let widened = widen(&surface, MipFilter::Kaiser);
    assert_eq!(widened.levels[1..], given);
}

#[test]
fn footprints_cover_their_source() {
    for (out, source) in [(1, 7), (3, 7), (4, 8), (8, 8), (8, 3), (5, 12)] {
        let all: Vec<Range<usize>> = (0..out)
            .map(|index| footprint(index, out, source))
            .collect();
        assert!(
            all.iter()
                .all(|range| !range.is_empty() && range.end <= source)
        );
        assert_eq!((all[0].start, all[out - 1].end), (0, source));
        for pair in all.windows(2) {
            assert!(pair[1].start <= pair[0].end, "{out} of {source}");
        }
    }
}
