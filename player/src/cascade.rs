//! Cascades of the shadow map: which parts of the view they cover, and their light matrices.
//!
//! The view is cut at parallel-split distances (Zhang et al. 2006). Each slice is covered by its bounding sphere, whose
//! size does not change when the camera turns, and the sphere's centre is rounded to whole texels of a grid that is
//! fixed in the scene: what a texel covers moves with neither translation nor rotation of the camera.

use cairn_format::gpu::GlobalUniform;
use cairn_format::{Aabb, Frustum};
use glam::{DMat4, DVec3, DVec4, Mat4, Vec3};

use crate::camera::{Camera, Projection};
use crate::settings::{Quality, ShadowFilter, ShadowSettings};

/// Most cascades, the arrays' length in [`GlobalUniform`].
pub const MAX_CASCADES: usize = 4;
/// Diagonals of the scene that shadows reach where the settings leave it open, and the camera is in the scene.
const REACH: f64 = 1.5;
/// Share of the reach below which splits do not begin: a nearer plane would take most cascades to itself.
const NEAREST: f64 = 1e-4;
/// Share of the scene's depth that is left free at both ends of the map's depth.
const DEPTH_MARGIN: f64 = 0.01;
/// Texels around a slice that PCSS may read beyond it.
const PCSS_BORDER: u32 = 16;

/// One cascade.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cascade {
    /// World to clip: depth 1 at the end of the scene towards the light, 0 at the other.
    pub matrix: Mat4,
    /// World to clip of what casts shadows into the slice: the slice, extruded towards the light.
    pub casters: Mat4,
    /// View depth at which the next cascade begins, metres.
    pub end: f32,
    /// Metres per texel, along both axes.
    pub texel: f32,
}

/// The cascades of one view and light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cascades {
    cascades: [Option<Cascade>; MAX_CASCADES],
    /// Metres between depths 0 and 1.
    pub depth_range: f32,
    /// View depth at which shadows end, metres.
    pub max_distance: f32,
    /// Texels of a side.
    pub resolution: u32,
}

/// The light's frame, and the scene in it.
struct LightSpace {
    right: DVec3,
    up: DVec3,
    /// Towards the light.
    back: DVec3,
    /// The scene's centre, the grid's origin.
    origin: DVec3,
    /// Radius of the scene's bounding sphere.
    radius: f64,
    /// Half the scene's extent along the light, margin included.
    half_depth: f64,
}

/// A sphere around a slice of the view: centre on the view axis at `depth`.
#[derive(Clone, Copy)]
struct Sphere {
    depth: f64,
    radius: f64,
}

impl Cascades {
    /// Covers what `camera` sees of a scene within `bounds`. `direction` is the light's unit direction of travel.
    /// There are fewer cascades than the settings ask for where one covers the whole scene, and none where
    /// there is no scene.
    pub fn fit(
        camera: &Camera,
        aspect: f32,
        direction: Vec3,
        bounds: Aabb,
        settings: &ShadowSettings,
    ) -> Self {
        let mut found = Self {
            resolution: settings.resolution,
            ..Self::default()
        };
        if bounds.is_empty() || !bounds.diagonal().is_finite() {
            return found;
        }
        let space = LightSpace::new(direction, bounds);
        let (near, far) = reach(camera, aspect, bounds, settings);
        found.depth_range = (2.0 * space.half_depth) as f32;
        found.max_distance = far as f32;
        let count = settings.cascades.clamp(1, MAX_CASCADES as u32);
        let mut begin = f64::from(camera.znear).min(near);
        for index in 0..count {
            let end = split(near, far, f64::from(settings.lambda), index + 1, count);
            let sphere = slice_sphere(camera, aspect, begin, end);
            let whole = sphere.radius >= space.radius;
            let end = if whole { far } else { end };
            found.cascades[index as usize] =
                Some(space.cascade(camera, (!whole).then_some(sphere), end, settings));
            begin = end;
            if whole {
                break;
            }
        }
        found
    }

    /// The cascades, nearest first.
    pub fn iter(&self) -> impl Iterator<Item = &Cascade> {
        self.cascades.iter().flatten()
    }

    /// Cascades.
    pub fn count(&self) -> u32 {
        self.iter().count() as u32
    }

    /// Writes every shadow field of the uniform. `angular_diameter` is the light's, radians.
    pub fn fill(
        &self,
        uniform: &mut GlobalUniform,
        settings: &ShadowSettings,
        angular_diameter: f32,
    ) {
        uniform.shadow_cascade_count = self.count();
        uniform.shadow_normal_offset = settings.normal_offset;
        uniform.shadow_texel_size = 1.0 / self.resolution as f32;
        uniform.shadow_max_distance = self.max_distance;
        uniform.shadow_blend_width = settings.blend_width;
        uniform.shadow_pcf_radius = settings.pcf_radius.min(5);
        uniform.shadow_distance_fade_width = settings.fade_width;
        uniform.shadow_mode = match settings.filter {
            ShadowFilter::Pcf => 0,
            ShadowFilter::Pcss => 1,
        };
        uniform.pcss_flags = u32::from(settings.early_out);
        (uniform.pcss_blocker_samples, uniform.pcss_pcf_samples) = match settings.quality {
            Quality::Low => (16, 16),
            Quality::Medium => (16, 25),
            Quality::High => (32, 49),
        };
        // A light of this angular diameter is as wide as this at a distance of one metre.
        let light_width = 2.0 * (angular_diameter * 0.5).tan();
        for (index, cascade) in self.iter().enumerate() {
            let width = cascade.texel * self.resolution as f32;
            uniform.cascade_view_proj[index] = cascade.matrix.to_cols_array_2d();
            uniform.cascade_splits[index] = cascade.end;
            uniform.cascade_texel_world_size[index] = cascade.texel;
            uniform.cascade_light_size_uv[index] = light_width / width;
            uniform.cascade_pcss_scale[index] = light_width / width * self.depth_range;
            uniform.cascade_uv_scale_y[index] = 1.0;
        }
    }
}

impl Cascade {
    /// What may cast a shadow into the slice.
    pub fn caster_frustum(&self) -> Frustum {
        Frustum::from_view_projection(&self.casters)
    }
}

impl LightSpace {
    fn new(direction: Vec3, bounds: Aabb) -> Self {
        let back = (-direction).as_dvec3().normalize();
        let (right, up) = back.any_orthonormal_pair();
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let half = (max - min) * 0.5;
        let origin = min + half;
        // A scene of one point has a size too: that of the roundings of its position, and a millimetre.
        let least = origin.abs().max_element() * 1e-5 + 1e-3;
        let radius = half.length().max(least);
        Self {
            right,
            up,
            back,
            origin,
            radius,
            half_depth: back.abs().dot(half).max(least) * (1.0 + 2.0 * DEPTH_MARGIN),
        }
    }

    /// The cascade of a slice's sphere, or of the scene's.
    fn cascade(
        &self,
        camera: &Camera,
        slice: Option<Sphere>,
        end: f64,
        settings: &ShadowSettings,
    ) -> Cascade {
        let (center, radius) = match slice {
            Some(sphere) => {
                let forward = camera.forward.as_dvec3();
                let center = camera.position.as_dvec3() + forward * sphere.depth;
                (center - self.origin, sphere.radius)
            }
            None => (DVec3::ZERO, self.radius),
        };
        let resolution = f64::from(settings.resolution);
        let inner = resolution - 2.0 * f64::from(border(settings));
        let half = radius * resolution / inner;
        let texel = 2.0 * half / resolution;
        // All three, so that equal grid cells give equal cascades, casters included.
        let snapped = |axis: DVec3| (axis.dot(center) / texel).round() * texel;
        let at = [snapped(self.right), snapped(self.up), snapped(self.back)];
        let (low, high) = (-self.half_depth, self.half_depth);
        // A texel more than the sphere, for the rounding of its centre.
        let slice_low = (at[2] - radius - texel).clamp(low, high - texel.min(high - low));
        Cascade {
            matrix: self.matrix(at, half, [low, high]),
            casters: self.matrix(at, half, [slice_low, high]),
            end: end as f32,
            texel: texel as f32,
        }
    }

    /// Orthographic, reverse-Z: `depth[1]` towards the light at 1.
    fn matrix(&self, center: [f64; 3], half: f64, depth: [f64; 2]) -> Mat4 {
        let row = |axis: DVec3, scale: f64, middle: f64| {
            let offset = axis.dot(self.origin) + middle;
            (axis * scale).extend(-offset * scale)
        };
        let rows = [
            row(self.right, 1.0 / half, center[0]),
            row(self.up, 1.0 / half, center[1]),
            row(self.back, 1.0 / (depth[1] - depth[0]), depth[0]),
        ];
        DMat4::from_cols(rows[0], rows[1], rows[2], DVec4::W)
            .transpose()
            .as_mat4()
    }
}

/// Texels at a map's edge that only filters read.
fn border(settings: &ShadowSettings) -> u32 {
    let kernel = match settings.filter {
        ShadowFilter::Pcf => settings.pcf_radius.min(5) + 2,
        ShadowFilter::Pcss => PCSS_BORDER,
    };
    kernel.min(settings.resolution / 8)
}

/// View depths between which shadows lie. They change in powers of two only, and never with the camera's direction,
/// so that cascades keep their sizes while the camera moves.
fn reach(camera: &Camera, aspect: f32, bounds: Aabb, settings: &ShadowSettings) -> (f64, f64) {
    let eye = camera.position;
    let farthest = (eye - bounds.min).abs().max((eye - bounds.max).abs());
    let nearest = (bounds.min - eye).max(eye - bounds.max).max(Vec3::ZERO);
    let mut far = f64::from(settings.max_distance);
    if far <= 0.0 {
        far = REACH * f64::from(bounds.diagonal()).max(1e-3);
        let needed = f64::from(farthest.length());
        if needed > far {
            far *= 2.0 * power_of_two_below(needed / far);
        }
    }
    let mut near = f64::from(camera.znear);
    match camera.projection {
        Projection::Perspective { yfov } => {
            // Points at the image's corners are the nearest along the view for their distance.
            let corner = 1.0 / (1.0 + corner_slope_squared(yfov, aspect)).sqrt();
            let distance = f64::from(nearest.length()) * corner;
            if distance > near {
                near = near.max(power_of_two_below(distance));
            }
        }
        Projection::Orthographic { .. } => far = far.min(f64::from(camera.zfar)),
    }
    far = far.max(f64::from(camera.znear) * 2.0).max(1e-6);
    (near.clamp(far * NEAREST, far * 0.5), far)
}

/// The greatest power of two that is no greater than a positive normal number.
fn power_of_two_below(value: f64) -> f64 {
    f64::from_bits(value.to_bits() & 0x7ff0_0000_0000_0000)
}

/// Squared tangent of the angle between the view and an image corner.
fn corner_slope_squared(yfov: f32, aspect: f32) -> f64 {
    let (slope, aspect) = ((f64::from(yfov) * 0.5).tan(), f64::from(aspect));
    slope * slope * (1.0 + aspect * aspect)
}

/// End of slice `index` of `count`, 1-based: `lambda` of the way from even to logarithmic.
fn split(near: f64, far: f64, lambda: f64, index: u32, count: u32) -> f64 {
    if index == count {
        return far;
    }
    let t = f64::from(index) / f64::from(count);
    let logarithmic = near * (far / near).powf(t);
    let even = near + (far - near) * t;
    lambda * logarithmic + (1.0 - lambda) * even
}

/// The least sphere around the slice of the view between two depths.
fn slice_sphere(camera: &Camera, aspect: f32, begin: f64, end: f64) -> Sphere {
    match camera.projection {
        Projection::Perspective { yfov } => {
            let k2 = corner_slope_squared(yfov, aspect);
            // Equally far from the corners of both ends, but no farther than the far end.
            let depth = ((begin + end) * 0.5 * (1.0 + k2)).min(end);
            let radius = ((end - depth).powi(2) + k2 * end * end).sqrt();
            Sphere { depth, radius }
        }
        Projection::Orthographic { half_height } => {
            let (half, aspect) = (f64::from(half_height), f64::from(aspect));
            let half_length = (end - begin) * 0.5;
            let corner = half * half * (1.0 + aspect * aspect);
            Sphere {
                depth: begin + half_length,
                radius: (corner + half_length * half_length).sqrt(),
            }
        }
    }
}

#[cfg(test)]
mod tests;
