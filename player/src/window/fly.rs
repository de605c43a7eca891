//! A camera that flies by keys and mouse.

use cairn_format::Aabb;
use glam::Vec3;
use winit::keyboard::KeyCode;

use crate::camera::Camera;

/// Radians per pixel of mouse movement.
const LOOK_SPEED: f32 = 0.003;
/// Steepest look up or down: at 90 degrees the view would have no right.
const MAX_PITCH: f32 = 89.0 * std::f32::consts::PI / 180.0;
/// Scene diagonals per second.
const MOVE_SPEED: f32 = 0.1;
/// Factor while Shift is held.
const FAST: f32 = 3.0;
/// Longest step in seconds, so that a stalled frame does not throw the camera out of the scene.
const MAX_STEP: f32 = 0.1;

/// Directions of flight, and whether each one's key is held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Held {
    forward: bool,
    back: bool,
    left: bool,
    right: bool,
    up: bool,
    down: bool,
    fast: bool,
}

/// The camera with its controls.
#[derive(Clone, Debug)]
pub(super) struct Fly {
    camera: Camera,
    bounds: Aabb,
    held: Held,
}

impl Fly {
    /// Begins at `camera` in a scene of these bounds.
    pub(super) fn new(camera: Camera, bounds: Aabb) -> Self {
        Self {
            camera,
            bounds,
            held: Held::default(),
        }
    }

    /// Jumps.
    #[cfg(feature = "ui")]
    pub(super) fn go(&mut self, camera: Camera) {
        self.camera = camera;
    }

    /// The camera now.
    pub(super) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// A key of flight goes down or up; other keys are ignored.
    pub(super) fn key(&mut self, key: KeyCode, pressed: bool) {
        let held = &mut self.held;
        let direction = match key {
            KeyCode::KeyW => &mut held.forward,
            KeyCode::KeyS => &mut held.back,
            KeyCode::KeyA => &mut held.left,
            KeyCode::KeyD => &mut held.right,
            KeyCode::Space => &mut held.up,
            KeyCode::ControlLeft | KeyCode::ControlRight | KeyCode::KeyC => &mut held.down,
            KeyCode::ShiftLeft | KeyCode::ShiftRight => &mut held.fast,
            _ => return,
        };
        *direction = pressed;
    }

    /// All keys are up: the window lost the focus and will not hear of their release.
    pub(super) fn release(&mut self) {
        self.held = Held::default();
    }

    /// Turns by a mouse movement in pixels, right and down positive; the horizon becomes level.
    pub(super) fn look(&mut self, pixels: [f32; 2]) {
        let forward = self.camera.forward;
        let yaw = forward.x.atan2(-forward.z) + pixels[0] * LOOK_SPEED;
        let pitch = forward.y.clamp(-1.0, 1.0).asin() - pixels[1] * LOOK_SPEED;
        let (sin, cos) = pitch.clamp(-MAX_PITCH, MAX_PITCH).sin_cos();
        self.camera.forward = Vec3::new(yaw.sin() * cos, sin, -yaw.cos() * cos);
        self.camera.up = Vec3::Y;
    }

    /// Flies for `seconds`.
    pub(super) fn step(&mut self, seconds: f32) {
        let axis = |positive: bool, negative: bool| f32::from(positive) - f32::from(negative);
        let held = self.held;
        let right = self
            .camera
            .forward
            .cross(self.camera.up)
            .normalize_or_zero();
        let direction = self.camera.forward * axis(held.forward, held.back)
            + right * axis(held.right, held.left)
            + Vec3::Y * axis(held.up, held.down);
        let speed = self.size() * MOVE_SPEED * if held.fast { FAST } else { 1.0 };
        let step = seconds.clamp(0.0, MAX_STEP) * speed;
        self.camera.position += direction.normalize_or_zero() * step;
    }

    /// Shows the whole scene in an image of `aspect` width over height.
    pub(super) fn frame(&mut self, aspect: f32) {
        self.camera = Camera::framing(self.bounds, aspect);
    }

    fn size(&self) -> f32 {
        match self.bounds.diagonal() {
            size if size > 0.0 && size.is_finite() => size,
            _ => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fly() -> Fly {
        let bounds = Aabb {
            min: Vec3::ZERO,
            max: Vec3::new(0.0, 0.0, 20.0),
        };
        Fly::new(Camera::default(), bounds)
    }

    #[test]
    fn keys_move_along_the_view_at_a_speed_of_the_scene() {
        let mut fly = fly();
        let start = fly.camera().position;
        fly.key(KeyCode::KeyW, true);
        fly.step(0.05);
        // A tenth of 20 m per second, along -Z.
        let moved = fly.camera().position - start;
        assert!(
            (moved - Vec3::new(0.0, 0.0, -0.1)).length() < 1e-6,
            "{moved}"
        );
        fly.key(KeyCode::ShiftLeft, true);
        fly.step(0.05);
        let moved = fly.camera().position - start;
        assert!((moved.z + 0.4).abs() < 1e-6, "{moved}");
        fly.release();
        fly.step(0.05);
        assert_eq!(fly.camera().position - start, moved);
    }

    #[test]
    fn opposite_keys_cancel_and_diagonals_are_not_faster() {
        let mut fly = fly();
        let start = fly.camera().position;
        fly.key(KeyCode::KeyA, true);
        fly.key(KeyCode::KeyD, true);
        fly.step(0.05);
        assert_eq!(fly.camera().position, start);
        fly.key(KeyCode::KeyA, false);
        fly.key(KeyCode::Space, true);
        fly.step(0.05);
        let moved = fly.camera().position - start;
        assert!((moved.length() - 0.1).abs() < 1e-6 && moved.x > 0.0 && moved.y > 0.0);
    }

    #[test]
    fn looking_follows_the_mouse_and_stops_below_the_zenith() {
        let mut fly = fly();
        fly.look([100.0, 0.0]);
        let forward = fly.camera().forward;
        assert!(
            (forward.x - 0.3f32.sin()).abs() < 1e-6 && forward.z < 0.0,
            "{forward}"
        );
        for _ in 0..100 {
            fly.look([0.0, -500.0]);
        }
        let pitch = fly.camera().forward.y.asin();
        assert!((pitch - MAX_PITCH).abs() < 1e-3, "{pitch}");
        assert!(fly.camera().view().is_finite());
        for _ in 0..100 {
            fly.look([0.0, 500.0]);
        }
        assert!((fly.camera().forward.y.asin() + MAX_PITCH).abs() < 1e-3);
    }

    #[test]
    fn a_stalled_frame_moves_no_farther_than_the_longest_step() {
        let mut fly = fly();
        let start = fly.camera().position;
        fly.key(KeyCode::KeyS, true);
        fly.step(1e6);
        assert!((fly.camera().position - start).length() < 0.21);
    }
}
