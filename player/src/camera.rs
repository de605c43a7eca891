//! Cameras: pose, projection, and the default view of a scene.

use cairn_format::Aabb;
use cairn_format::scene::{ArchivedCamera, ArchivedProjectionKind};
use glam::{Mat4, Vec3, Vec4};

/// How view space maps to the image plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians; the far plane is infinite.
    Perspective { yfov: f32 },
    /// Half the visible height in metres.
    Orthographic { half_height: f32 },
}

/// A camera in the world, metres, Y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub position: Vec3,
    /// Unit view direction.
    pub forward: Vec3,
    /// Not parallel to `forward`.
    pub up: Vec3,
    pub projection: Projection,
    pub znear: f32,
    /// Orthographic only.
    pub zfar: f32,
}

/// Vertical field of view of the default camera, radians.
const DEFAULT_YFOV: f32 = 0.75;

impl Camera {
    /// Looks from `eye` at `target`; `None` where both coincide, or `up` is parallel to the view.
    pub fn look_at(eye: Vec3, target: Vec3, up: Vec3, yfov: f32) -> Option<Self> {
        let forward = (target - eye).try_normalize()?;
        let up = (up - forward * up.dot(forward)).try_normalize()?;
        Some(Self {
            position: eye,
            forward,
            up,
            projection: Projection::Perspective { yfov },
            znear: 0.01,
            zfar: 1000.0,
        })
    }

    /// A three-quarter view that holds all of `bounds` in an image of `aspect` width over height.
    pub fn framing(bounds: Aabb, aspect: f32) -> Self {
        let (center, radius) = if bounds.is_empty() || bounds.diagonal() <= 0.0 {
            (Vec3::ZERO, 1.0)
        } else {
            (bounds.center(), bounds.diagonal() * 0.5)
        };
        let half_vertical = DEFAULT_YFOV * 0.5;
        let half_horizontal = (half_vertical.tan() * aspect).atan();
        let distance = radius / half_vertical.min(half_horizontal).sin();
        let direction = Vec3::new(0.45, 0.35, 1.0).normalize();
        let eye = center + direction * distance;
        let camera = Self::look_at(eye, center, Vec3::Y, DEFAULT_YFOV);
        camera.map_or_else(Self::default, |camera| camera.with_near_for(bounds))
    }

    /// Moves the near plane as far out as the bounds allow: reverse-Z with an infinite far plane keeps its
    /// precision over eight decades, so a thousandth of the scene's size is near enough.
    pub fn with_near_for(self, bounds: Aabb) -> Self {
        let size = if bounds.is_empty() {
            1.0
        } else {
            bounds.diagonal()
        };
        Self {
            znear: (size * 1e-3).clamp(1e-6, 0.1),
            ..self
        }
    }

    /// A camera of the package.
    pub fn from_package(camera: &ArchivedCamera) -> Option<Self> {
        let vector = |value| Vec3::from(cairn_format::scene::natives(value));
        let extent = camera.extent.to_native();
        let forward = vector(&camera.forward).try_normalize()?;
        let up = vector(&camera.up);
        let projection = match camera.projection {
            ArchivedProjectionKind::Perspective => Projection::Perspective { yfov: extent },
            ArchivedProjectionKind::Orthographic => Projection::Orthographic {
                half_height: extent,
            },
        };
        let znear = camera.znear.to_native();
        let up = (up - forward * up.dot(forward)).try_normalize()?;
        (extent > 0.0).then_some(Self {
            position: vector(&camera.position),
            forward,
            up,
            projection,
            znear: match projection {
                Projection::Perspective { .. } => znear.max(1e-6),
                Projection::Orthographic { .. } => znear,
            },
            zfar: camera.zfar.to_native().max(znear + 1e-3),
        })
    }

    /// World to view: x right, y up, looking along -z.
    pub fn view(&self) -> Mat4 {
        let right = self.forward.cross(self.up).normalize();
        let up = right.cross(self.forward);
        let rows = [right, up, -self.forward];
        let row = |axis: Vec3| axis.extend(-axis.dot(self.position));
        Mat4::from_cols(row(rows[0]), row(rows[1]), row(rows[2]), Vec4::W).transpose()
    }

    /// View to clip, reverse-Z: the near plane at depth 1, infinity (or `zfar`) at 0.
    pub fn projection(&self, aspect: f32) -> Mat4 {
        match self.projection {
            Projection::Perspective { yfov } => {
                let f = 1.0 / (yfov * 0.5).tan();
                Mat4::from_cols(
                    Vec4::new(f / aspect, 0.0, 0.0, 0.0),
                    Vec4::new(0.0, f, 0.0, 0.0),
                    Vec4::new(0.0, 0.0, 0.0, -1.0),
                    Vec4::new(0.0, 0.0, self.znear, 0.0),
                )
            }
            Projection::Orthographic { half_height } => {
                let depth = self.zfar - self.znear;
                Mat4::from_cols(
                    Vec4::new(1.0 / (half_height * aspect), 0.0, 0.0, 0.0),
                    Vec4::new(0.0, 1.0 / half_height, 0.0, 0.0),
                    Vec4::new(0.0, 0.0, 1.0 / depth, 0.0),
                    Vec4::new(0.0, 0.0, self.zfar / depth, 1.0),
                )
            }
        }
    }
}

impl Default for Camera {
    /// At (0, 0, 3), looking along -Z.
    fn default() -> Self {
        Self {
            position: Vec3::new(0.0, 0.0, 3.0),
            forward: Vec3::NEG_Z,
            up: Vec3::Y,
            projection: Projection::Perspective { yfov: DEFAULT_YFOV },
            znear: 0.01,
            zfar: 1000.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn project(camera: &Camera, aspect: f32, point: Vec3) -> Vec3 {
        (camera.projection(aspect) * camera.view()).project_point3(point)
    }

    #[test]
    fn depth_is_one_at_near_and_falls_towards_infinity() {
        let camera = Camera::default();
        let at =
            |distance: f32| project(&camera, 1.5, camera.position + camera.forward * distance).z;
        assert!((at(camera.znear) - 1.0).abs() < 1e-6);
        let mut last = 1.1;
        for exponent in 0..70 {
            let depth = at(0.01 * 1.5f32.powi(exponent));
            assert!(depth < last && depth > 0.0, "depth {depth} after {last}");
            last = depth;
        }
    }

    #[test]
    fn orthographic_depth_runs_from_near_to_far() {
        let camera = Camera {
            projection: Projection::Orthographic { half_height: 2.0 },
            znear: 1.0,
            zfar: 5.0,
            ..Camera::default()
        };
        let at = |distance: f32| project(&camera, 2.0, camera.position + camera.forward * distance);
        assert!((at(1.0).z - 1.0).abs() < 1e-6);
        assert!(at(5.0).z.abs() < 1e-6);
        let corner = camera.position + Vec3::new(4.0, 2.0, -2.0);
        assert!(
            (project(&camera, 2.0, corner).truncate() - 1.0)
                .abs()
                .max_element()
                < 1e-6
        );
    }

    #[test]
    fn framing_shows_every_corner() {
        for aspect in [0.5, 1.0, 2.0] {
            let bounds = Aabb {
                min: Vec3::new(-3.0, 0.0, -1.0),
                max: Vec3::new(5.0, 2.0, 9.0),
            };
            let camera = Camera::framing(bounds, aspect);
            for corner in 0..8 {
                let pick = |axis: usize| {
                    if corner >> axis & 1 == 0 {
                        bounds.min[axis]
                    } else {
                        bounds.max[axis]
                    }
                };
                let ndc = project(&camera, aspect, Vec3::new(pick(0), pick(1), pick(2)));
                assert!(ndc.x.abs() <= 1.0 && ndc.y.abs() <= 1.0 && ndc.z <= 1.0);
            }
        }
    }

    #[test]
    fn a_scene_of_nothing_has_a_camera() {
        let camera = Camera::framing(Aabb::EMPTY, 1.0);
        assert!(camera.position.is_finite() && camera.view().is_finite());
    }

    #[test]
    fn looking_straight_down_needs_another_up() {
        assert!(Camera::look_at(Vec3::Y, Vec3::ZERO, Vec3::Y, 1.0).is_none());
        assert!(Camera::look_at(Vec3::Y, Vec3::Y, Vec3::Y, 1.0).is_none());
        assert!(Camera::look_at(Vec3::Y, Vec3::ZERO, Vec3::X, 1.0).is_some());
    }
}
