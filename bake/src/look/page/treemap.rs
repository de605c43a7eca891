//! Rectangles whose areas are numbers: squarified treemaps (Bruls, Huizing, van Wijk 2000).

/// A rectangle in parts of the whole: left, top, width, height.
pub type Rectangle = [f64; 4];

/// Lays `sizes`, which descend, out in `area`; sizes of zero get empty rectangles.
pub fn lay_out(sizes: &[f64], area: Rectangle) -> Vec<Rectangle> {
    let total: f64 = sizes.iter().sum();
    if total <= 0.0 {
        return vec![[area[0], area[1], 0.0, 0.0]; sizes.len()];
    }
    let scale = area[2] * area[3] / total;
    let areas: Vec<f64> = sizes.iter().map(|size| size * scale).collect();
    let (mut done, mut rest) = (Vec::with_capacity(sizes.len()), area);
    let mut start = 0;
    while start < areas.len() {
        let side = rest[2].min(rest[3]);
        let mut end = start + 1;
        while end < areas.len()
            && worst(&areas[start..=end], side) <= worst(&areas[start..end], side)
        {
            end += 1;
        }
        rest = row(&areas[start..end], rest, &mut done);
        start = end;
    }
    done
}

/// The worst ratio of sides in a row along `side`.
fn worst(areas: &[f64], side: f64) -> f64 {
    let sum: f64 = areas.iter().sum();
    let thickness = sum / side;
    let ratio = |area: &f64| {
        let length = area / thickness;
        (length / thickness).max(thickness / length)
    };
    areas.iter().map(ratio).fold(0.0, f64::max)
}

/// Puts a row along the shorter side, and gives what is left of the area.
fn row(
    areas: &[f64],
    [left, top, width, height]: Rectangle,
    done: &mut Vec<Rectangle>,
) -> Rectangle {
    let sum: f64 = areas.iter().sum();
    let side = width.min(height);
    let thickness = if side > 0.0 { sum / side } else { 0.0 };
    let mut along = 0.0;
    for area in areas {
        let length = if thickness > 0.0 {
            area / thickness
        } else {
            0.0
        };
        done.push(if width < height {
            [left + along, top, length, thickness]
        } else {
            [left, top + along, thickness, length]
        });
        along += length;
    }
    if width < height {
        [left, top + thickness, width, (height - thickness).max(0.0)]
    } else {
        [left + thickness, top, (width - thickness).max(0.0), height]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn areas_are_shares_and_nothing_overlaps(sizes in prop::collection::vec(1_u32..10_000, 1..40)) {
            let mut sizes: Vec<f64> = sizes.into_iter().map(f64::from).collect();
            sizes.sort_by(|a, b| b.total_cmp(a));
            let total: f64 = sizes.iter().sum();
            let area = [1.0, 2.0, 16.0, 9.0];
            let boxes = lay_out(&sizes, area);
            prop_assert_eq!(boxes.len(), sizes.len());
            for (index, [x, y, w, h]) in boxes.iter().copied().enumerate() {
                prop_assert!((w * h - sizes[index] / total * 144.0).abs() < 1e-6);
                prop_assert!(x >= 1.0 - 1e-9 && y >= 2.0 - 1e-9 && x + w <= 17.0 + 1e-6 && y + h <= 11.0 + 1e-6);
                for [a, b, c, d] in &boxes[..index] {
                    let across = (x + w).min(a + c) - x.max(*a);
                    let down = (y + h).min(b + d) - y.max(*b);
                    prop_assert!(across < 1e-6 || down < 1e-6);
                }
            }
        }
    }

    #[test]
    fn nothing_has_no_area() {
        assert_eq!(lay_out(&[0.0], [0.0, 0.0, 1.0, 1.0]), [[0.0; 4]]);
        assert!(lay_out(&[], [0.0, 0.0, 1.0, 1.0]).is_empty());
    }
}
