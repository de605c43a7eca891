//! Tangents by MikkTSpace, with an orthonormal stand-in where it gives none.

use glam::DVec3;

use super::mikktspace;
pub(super) use super::mikktspace::Corners;

/// Tangents shorter than this have no usable direction.
const MIN_LENGTH: f64 = 1e-6;
/// Tangents whose sine with the normal is smaller span no plane with it.
const MIN_SINE: f64 = 1e-3;

/// The tangent of every corner, w +1 or -1 in glTF's sense, and how many are stand-ins.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Generated {
    pub(super) tangents: Vec<[f32; 4]>,
    pub(super) fallbacks: u64,
}

/// Runs MikkTSpace on the unindexed triangles (Mikkelsen 2008), bit for bit, with w negated: glTF's V points down.
///
/// `None` where a vertex with opposite tangents has more than [`mikktspace::MAX_SPLIT`] triangles.
pub(super) fn generate<C: Corners + ?Sized>(corners: &C) -> Option<Generated> {
    let mut tangents = mikktspace::generate(corners).ok()?;
    let mut fallbacks = 0;
    for (corner, tangent) in tangents.iter_mut().enumerate() {
        let normal = corners.normal(corner);
        if usable(normal, *tangent) {
            tangent[3] = -tangent[3];
        } else {
            *tangent = fallback(normal);
            fallbacks += 1;
        }
    }
    Some(Generated {
        tangents,
        fallbacks,
    })
}

/// An authored tangent with w snapped to +1 or -1, or a stand-in where it is unusable, and whether it is one.
pub(super) fn authored(normal: [f32; 3], tangent: [f32; 4]) -> ([f32; 4], bool) {
    if !usable(normal, tangent) {
        return (fallback(normal), true);
    }
    let [x, y, z, w] = tangent;
    ([x, y, z, if w < 0.0 { -1.0 } else { 1.0 }], false)
}

/// A unit tangent orthogonal to `normal` (Duff et al. 2017), which may have any length, with w = 1.
pub(super) fn fallback(normal: [f32; 3]) -> [f32; 4] {
    let normal = DVec3::from(normal.map(f64::from));
    let length = normal.length();
    if length == 0.0 {
        return [1.0, 0.0, 0.0, 1.0];
    }
    let n = normal / length;
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let tangent = DVec3::new(
        1.0 + sign * n.x * n.x * a,
        sign * n.x * n.y * a,
        -sign * n.x,
    );
    tangent.as_vec3().extend(1.0).to_array()
}

/// Sine of the angle between `tangent` and the plane of `normal`; 0 without a normal.
pub(super) fn tilt(normal: [f32; 3], tangent: [f32; 4]) -> f64 {
    let (n, t) = (widened(normal), direction(tangent));
    let lengths = n.length() * t.length();
    if lengths > 0.0 {
        (n.dot(t) / lengths).abs()
    } else {
        0.0
    }
}

fn widened(vector: [f32; 3]) -> DVec3 {
    DVec3::from(vector.map(f64::from))
}

fn direction([x, y, z, _]: [f32; 4]) -> DVec3 {
    widened([x, y, z])
}

/// Whether `tangent` spans a plane with `normal`; a zero normal spans none, and any direction will do.
fn usable(normal: [f32; 3], tangent: [f32; 4]) -> bool {
    let (n, t) = (widened(normal), direction(tangent));
    let lengths = n.length() * t.length();
    t.is_finite()
        && t.length() >= MIN_LENGTH
        && (lengths == 0.0 || n.cross(t).length() >= MIN_SINE * lengths)
}

#[cfg(test)]
#[path = "tangents_tests.rs"]
mod tests;
