//! The nearest of many points: a k-d tree (Bentley 1975) in one array, medians in the middle of their halves.

use glam::Vec3;

/// Points in the order of the tree.
pub struct Points {
    points: Vec<Vec3>,
}

impl Points {
    /// Sorts points into a tree.
    pub fn new(points: &[Vec3]) -> Self {
        let mut points = points.to_vec();
        sort(&mut points, 0);
        Self { points }
    }

    /// Squared distance to the nearest point; infinite where there is none.
    pub fn nearest_squared(&self, point: Vec3) -> f64 {
        let mut best = f64::INFINITY;
        search(&self.points, 0, point, &mut best);
        best
    }
}

fn sort(points: &mut [Vec3], axis: usize) {
    if points.len() < 2 {
        return;
    }
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    let (left, right) = points.split_at_mut(middle);
    sort(left, (axis + 1) % 3);
    sort(&mut right[1..], (axis + 1) % 3);
}

fn search(points: &[Vec3], axis: usize, point: Vec3, best: &mut f64) {
    let middle = points.len() / 2;
    let Some(here) = points.get(middle) else {
        return;
    };
    *best = best.min(here.as_dvec3().distance_squared(point.as_dvec3()));
    let side = f64::from(point[axis]) - f64::from(here[axis]);
    let (left, right) = (&points[..middle], &points[middle + 1..]);
    let (near, far) = if side < 0.0 {
        (left, right)
    } else {
        (right, left)
    };
    search(near, (axis + 1) % 3, point, best);
    if side * side < *best {
        search(far, (axis + 1) % 3, point, best);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_nearest_of_all(
            points in prop::collection::vec(prop::array::uniform3(-9_i8..9), 0..60),
            point in prop::array::uniform3(-12.0_f32..12.0),
        ) {
            let points: Vec<Vec3> = points
                .into_iter()
                .map(|point| Vec3::from(point.map(f32::from)))
                .collect();
            let distances = points
                .iter()
                .map(|other| other.as_dvec3().distance_squared(Vec3::from(point).as_dvec3()));
            let expected = distances.fold(f64::INFINITY, f64::min);
            prop_assert_eq!(Points::new(&points).nearest_squared(point.into()), expected);
        }
    }
}
