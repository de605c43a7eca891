//! Rays that leave a plane do not meet it again, from 1e-5 m to 1e4 m from the middle of the scene.

use bytemuck::Zeroable;
use cairn_format::Vertex;
use glam::{Mat4, Vec3};

use super::super::device;
use super::super::fixture::{Fixture, Object};
use super::{samples, trace, traced, white};
use crate::camera::Camera;
use crate::gpu::Gpu;

/// Pixels of a picture, and its samples: half as many rays as each distance gets, of which each is followed by another.
const SIZE: [u32; 2] = [96, 96];
const SAMPLES: u32 = 28;

/// A convex solid with flat faces: no ray that leaves a face outwards meets any other.
fn solid(corners: &[[f32; 3]], faces: &[[usize; 3]], scale: f32, models: Vec<Mat4>) -> Object {
    let mut object = Object {
        vertices: Vec::new(),
        colors: Vec::new(),
        indices: Vec::new(),
        material: 0,
        models,
    };
    for face in faces {
        let places = face.map(|corner| Vec3::from(corners[corner]));
        let normal = (places[1] - places[0]).cross(places[2] - places[0]);
        for place in places {
            object.indices.push(object.vertices.len() as u32);
            object.vertices.push(Vertex {
                position: (place * scale).to_array(),
                normal: normal.normalize().to_array(),
                ..Vertex::zeroed()
            });
        }
    }
    object
}

/// Its faces lie on planes across the axes, where one coordinate is the same everywhere.
fn cube(scale: f32, models: Vec<Mat4>) -> Object {
    let corner =
        |index: usize| [0, 1, 2].map(|axis| if index >> axis & 1 == 1 { 1.0 } else { -1.0 });
    let corners: Vec<[f32; 3]> = (0..8).map(corner).collect();
    let mut faces = Vec::new();
    for axis in 0..3 {
        let (u, v, w) = (1 << axis, 1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        faces.extend([[u, u + v, u + v + w], [u, u + v + w, u + w]]);
        faces.extend([[0, v + w, v], [0, w, v + w]]);
    }
    solid(&corners, &faces, scale, models)
}

/// Its faces lie on planes askew to the axes.
fn icosahedron(scale: f32, models: Vec<Mat4>) -> Object {
    let golden = (1.0 + 5.0_f32.sqrt()) * 0.5;
    let mut corners = Vec::new();
    for axis in 0..3 {
        for (one, other) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let mut corner = [0.0; 3];
            corner[(axis + 1) % 3] = one;
            corner[(axis + 2) % 3] = other * golden;
            corners.push(corner);
        }
    }
    let near = |a: usize, b: usize| {
        let distance = Vec3::from(corners[a]).distance(Vec3::from(corners[b]));
        (distance - 2.0).abs() < 1e-3
    };
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let [p, q, r] = [a, b, c].map(|corner| Vec3::from(corners[corner]));
                    let outwards = (q - p).cross(r - p).dot(p) > 0.0;
                    faces.push(if outwards { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    assert_eq!(faces.len(), 20);
    solid(&corners, &faces, scale, models)
}

/// Share of rays that met something, of those that leave what the camera sees by cosine; all pixels see the object.
fn self_hits(gpu: &Gpu, objects: Vec<Object>, eye: Vec3, target: Vec3) -> f64 {
    let fixture = Fixture {
        objects,
        materials: vec![white(0.0, 1.0)],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let mut settings = traced();
    settings.debug_view = 9;
    settings.ao.radius = 1e9;
    let camera = Camera::look_at(eye, target, Vec3::new(0.1, 1.0, 0.2), 0.3).expect("a view");
    let image = trace(gpu, &fixture, SIZE, camera, settings, &samples(SAMPLES));
    let hdr = image.hdr.as_ref().expect("read back");
    1.0 - hdr.iter().map(|texel| f64::from(texel[0])).sum::<f64>() / hdr.len() as f64
}

/// Turned, stretched along each axis, and turned inside out.
fn askew(scale: f32) -> Mat4 {
    Mat4::from_rotation_y(0.7)
        * Mat4::from_rotation_x(0.4)
        * Mat4::from_scale(Vec3::new(-1.3, 0.8, 1.1) * scale)
        * Mat4::from_rotation_z(0.3)
}

#[test]
fn planes_do_not_shadow_themselves() {
    let Some(gpu) = device() else { return };
    for distance in [
        1e-5f32,
        1e-4,
        1e-3,
        1e-2,
        1.0 / 32.0,
        0.1,
        1.0,
        1e2,
        1e3,
        1e4,
    ] {
        let eye = Vec3::new(0.83, 0.71, 0.92) * distance * 2.5;
        // Places in the vertices, and in the transform, which also mirrors.
        let straight = cube(distance, vec![Mat4::IDENTITY]);
        let turned = icosahedron(0.7, vec![askew(distance)]);
        for (name, object) in [("cube", straight), ("icosahedron", turned)] {
            let hits = self_hits(&gpu, vec![object], eye, Vec3::ZERO);
            assert_eq!(hits, 0.0, "{name} at {distance} m");
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Small things far from the middle of the scene, where floats are coarse: two of each, so that the middle is between.
#[test]
fn small_things_far_out_do_not_shadow_themselves() {
    let Some(gpu) = device() else { return };
    for (far, size) in [(1e2f32, 0.1), (1e4, 30.0)] {
        let place = Vec3::new(0.6, -0.3, 0.9) * far;
        let models = |turn: Mat4| {
            [place, -place]
                .map(|place| Mat4::from_translation(place) * turn)
                .to_vec()
        };
        for object in [
            cube(size, models(Mat4::IDENTITY)),
            icosahedron(0.7, models(askew(size))),
        ] {
            let eye = place + Vec3::new(0.83, 0.71, 0.92) * size * 2.5;
            let hits = self_hits(&gpu, vec![object], eye, place);
            assert_eq!(hits, 0.0, "{size} m, {far} m out");
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}
