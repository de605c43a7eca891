//! Random views and boxes, and f64 truth about which of them touch.

use cairn_format::Aabb;
use glam::{DMat4, DQuat, DVec3, DVec4, EulerRot, Mat4, Vec3};

/// SplitMix64 (Steele, Lea and Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, limit: u64) -> u64 {
        self.bits() % limit
    }

    /// Uniform in `low..high`.
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (self.bits() >> 11) as f64 * 2f64.powi(-53) * (high - low)
    }

    /// Either sign, the magnitude uniform in the exponent of ten.
    pub fn decade(&mut self, low: f64, high: f64) -> f64 {
        let magnitude = 10f64.powf(self.range(low, high));
        if self.below(2) == 0 {
            magnitude
        } else {
            -magnitude
        }
    }

    pub fn vector(&mut self, low: f64, high: f64) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.range(low, high)))
    }
}

/// A world-to-clip matrix with the exact value of its f32 form.
pub struct View {
    pub matrix: Mat4,
    /// `dot(plane.xyz, p) + plane.w >= 0` inside.
    planes: [DVec4; 6],
    /// `None` where the matrix has none in f64.
    shape: Option<Shape>,
}

/// A pyramid's stump.
struct Shape {
    near: [DVec3; 4],
    /// From the near corners to the far ones.
    rays: [DVec3; 4],
    /// Whether the far corners are at infinity; then a ray has the length by which clip w grows by 1.
    endless: bool,
}

impl View {
    pub fn new(exact: &DMat4) -> Self {
        let matrix = exact.as_mat4();
        let exact = matrix.as_dmat4();
        let row = |i| exact.row(i);
        let planes = [
            row(3) + row(0),
            row(3) - row(0),
            row(3) + row(1),
            row(3) - row(1),
            row(2),
            row(3) - row(2),
        ];
        Self {
            matrix,
            planes,
            shape: Shape::new(&exact),
        }
    }

    /// An infinite or finite perspective or an orthographic view, from near or far off the origin, sometimes
    /// along the axes.
    pub fn random(random: &mut Random) -> Self {
        let eye = match random.below(3) {
            0 => DVec3::ZERO,
            1 => random.vector(-50.0, 50.0),
            _ => random.vector(-1e5, 1e5),
        };
        let turn = match random.below(4) {
            0 => DVec3::from_array(std::array::from_fn(|_| {
                random.below(4) as f64 * std::f64::consts::FRAC_PI_2
            })),
            _ => random.vector(0.0, 6.3),
        };
        let rotation = DQuat::from_euler(EulerRot::YXZ, turn.x, turn.y, turn.z);
        let view = DMat4::from_quat(rotation) * DMat4::from_translation(-eye);
        let near = random.decade(-3.0, 0.5).abs();
        let (yfov, aspect) = (random.range(0.05, 2.8), random.range(0.3, 3.0));
        let projection = match random.below(4) {
            0 => reverse_z(yfov, aspect, near, near + random.range(1.0, 1e3)),
            1 => orthographic(aspect, near, 1e3),
            _ => infinite_reverse_z(yfov, aspect, near),
        };
        Self::new(&(projection * view))
    }

    /// Whether the corner of the box farthest inside is inside, for every plane.
    pub fn passes_planes(&self, aabb: &Aabb) -> bool {
        let (min, max) = (aabb.min.as_dvec3(), aabb.max.as_dvec3());
        self.planes.iter().all(|plane| {
            let normal = plane.truncate();
            let corner = DVec3::select(normal.cmpge(DVec3::ZERO), max, min);
            let directed = normal != DVec3::ZERO;
            !directed || normal.dot(corner) + plane.w >= 0.0
        })
    }

    /// Whether no plane, no face of the box and no cross product of two edges separates the box from the view.
    /// Says `true` where the view's shape is unknown.
    pub fn touches(&self, aabb: &Aabb) -> bool {
        if !self.passes_planes(aabb) {
            return false;
        }
        let Some(shape) = &self.shape else {
            return true;
        };
        let [origin, right, up, _] = shape.near;
        let edges = shape.rays.into_iter().chain([right - origin, up - origin]);
        let crossed = edges.flat_map(|edge| DVec3::AXES.map(|axis| edge.cross(axis)));
        let mut axes = DVec3::AXES.into_iter().chain(crossed);
        axes.all(|axis| !shape.is_separated(axis, aabb))
    }

    /// A point on the surface of the view or a little beside it, where the shape is known.
    pub fn surface_point(&self, random: &mut Random) -> Option<DVec3> {
        let shape = self.shape.as_ref()?;
        let (mut u, mut v) = (random.range(0.0, 1.0), random.range(0.0, 1.0));
        let depth = match random.below(4) {
            0 => 0.0,
            _ => {
                let side = random.below(2) as f64;
                *[&mut u, &mut v][random.below(2) as usize] = side;
                random.range(0.0, 3.0)
            }
        };
        let at = |of: &[DVec3; 4]| of[0].lerp(of[1], u).lerp(of[2].lerp(of[3], u), v);
        Some(at(&shape.near) + at(&shape.rays) * depth)
    }
}

pub fn infinite_reverse_z(yfov: f64, aspect: f64, near: f64) -> DMat4 {
    let f = 1.0 / (yfov * 0.5).tan();
    DMat4::from_cols(
        DVec4::new(f / aspect, 0.0, 0.0, 0.0),
        DVec4::new(0.0, f, 0.0, 0.0),
        DVec4::new(0.0, 0.0, 0.0, -1.0),
        DVec4::new(0.0, 0.0, near, 0.0),
    )
}

/// Far plane at clip z 0.
fn reverse_z(yfov: f64, aspect: f64, near: f64, far: f64) -> DMat4 {
    let mut matrix = infinite_reverse_z(yfov, aspect, near);
    matrix.z_axis.z = near / (far - near);
    matrix.w_axis.z = near * far / (far - near);
    matrix
}

/// 2 high; near plane at clip z 1.
fn orthographic(aspect: f64, near: f64, far: f64) -> DMat4 {
    DMat4::from_cols(
        DVec4::new(1.0 / aspect, 0.0, 0.0, 0.0),
        DVec4::Y,
        DVec4::new(0.0, 0.0, 1.0 / (far - near), 0.0),
        DVec4::new(0.0, 0.0, far / (far - near), 1.0),
    )
}

impl Shape {
    fn new(matrix: &DMat4) -> Option<Self> {
        let inverse = matrix.try_inverse()?;
        let endless = matrix.row(2).truncate() == DVec3::ZERO;
        let corners = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
        let near = corners.map(|(x, y)| inverse.project_point3(DVec3::new(x, y, 1.0)));
        let rays = std::array::from_fn(|i| {
            let far = inverse * DVec4::new(corners[i].0, corners[i].1, 0.0, 1.0);
            match endless {
                true => far.truncate(),
                false => far.truncate() / far.w - near[i],
            }
        });
        let finite = near.iter().chain(&rays).all(|point| point.is_finite());
        finite.then_some(Self {
            near,
            rays,
            endless,
        })
    }

    /// Whether a plane across `axis` has this on one side and the box on the other.
    fn is_separated(&self, axis: DVec3, aabb: &Aabb) -> bool {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (corner, ray) in self.near.iter().zip(&self.rays) {
            let (start, along) = (axis.dot(*corner), axis.dot(*ray));
            let across = along.abs() <= 1e-12 * axis.length() * ray.length();
            let end = match self.endless {
                true if across => start,
                true => along * f64::INFINITY,
                false => start + along,
            };
            low = low.min(start).min(end);
            high = high.max(start).max(end);
        }
        let (min, max) = (aabb.min.as_dvec3(), aabb.max.as_dvec3());
        let positive = axis.cmpge(DVec3::ZERO);
        let least = axis.dot(DVec3::select(positive, min, max));
        let most = axis.dot(DVec3::select(positive, max, min));
        most < low || least > high
    }
}

/// A finite box: anywhere, huge, tiny, flat, a point, or with the corner that decides on the view's surface.
pub fn random_box(random: &mut Random, view: &View) -> Aabb {
    let center = match random.below(8) {
        0 => random.vector(-1.0, 1.0) * random.decade(-45.0, 37.0),
        1 | 2 => random.vector(-100.0, 100.0),
        _ => match view.surface_point(random) {
            Some(point) => point * (1.0 + random.decade(-9.0, -6.0) * random.below(2) as f64),
            None => random.vector(-1.0, 1.0),
        },
    };
    let size = random.decade(-6.0, 2.0).abs()
        * random
            .decade(-40.0, 34.0)
            .powi(random.below(8).min(1) as i32 ^ 1);
    let extent = random.vector(0.0, 1.0) * size.abs();
    let corner = center.as_vec3();
    let mut opposite = corner;
    for axis in 0..3 {
        opposite[axis] = match random.below(5) {
            0 => corner[axis],
            1 | 2 => (center[axis] + extent[axis]) as f32,
            _ => (center[axis] - extent[axis]) as f32,
        };
    }
    let finite = |corner: Vec3| corner.clamp(Vec3::splat(f32::MIN), Vec3::splat(f32::MAX));
    let (corner, opposite) = (finite(corner), finite(opposite));
    Aabb {
        min: corner.min(opposite),
        max: corner.max(opposite),
    }
}
