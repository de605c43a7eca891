//! Which faces are seen, with which normal, in which order, and with which texture.

use cairn_format::TextureFormat;
use cairn_format::gpu::{
    ALPHA_BLEND, ALPHA_MASK, MATERIAL_DOUBLE_SIDED, MATERIAL_UNLIT, Material, TEXTURE_UV1,
};
use glam::{Mat3, Mat4, Quat, Vec3};

use super::fixture::{Fixture, light, quad, row, sphere, unlit};
use super::{assert_near, device, middle, plain, shoot, towards_origin};
use crate::gpu::Gpu;
use crate::settings::Settings;

const FRONT: Vec3 = Vec3::new(0.0, 0.0, 3.0);
const BEHIND: Vec3 = Vec3::new(0.0, 0.0, -3.0);
const BLACK: [f32; 3] = [0.0; 3];

/// The middle of an image of squares.
fn seen(gpu: &Gpu, fixture: &Fixture, eye: Vec3, settings: Settings) -> [f32; 3] {
    middle(&shoot(gpu, fixture, [15, 9], towards_origin(eye), settings))
}

fn white(double_sided: u32) -> Material {
    Material {
        metallic_factor: 0.0,
        double_sided,
        ..Material::default()
    }
}

/// One square under a light that shines along `travel`.
fn lit_square(material: Material, model: Mat4, travel: Vec3) -> Fixture {
    Fixture {
        objects: vec![quad(0, vec![model])],
        materials: vec![material],
        lights: vec![light(travel, [1.0; 3], 3.0)],
        ..Fixture::default()
    }
}

fn dark() -> Settings {
    Settings {
        ibl_intensity: 0.0,
        ..plain()
    }
}

#[test]
fn single_sided_back_faces_are_culled() {
    let Some(gpu) = device() else { return };
    let square = lit_square(white(0), Mat4::IDENTITY, Vec3::Z);
    assert_eq!(seen(&gpu, &square, BEHIND, dark()), BLACK);
}

#[test]
fn double_sided_back_faces_are_lit_like_fronts() {
    let Some(gpu) = device() else { return };
    let front = lit_square(white(0), Mat4::IDENTITY, Vec3::NEG_Z);
    let reference = seen(&gpu, &front, FRONT, dark());
    assert!(reference[0] > 0.5, "{reference:?}");
    let material = white(MATERIAL_DOUBLE_SIDED);
    let back = lit_square(material, Mat4::IDENTITY, Vec3::Z);
    assert_near(seen(&gpu, &back, BEHIND, dark()), reference, 1e-3);
    let shadowed = lit_square(material, Mat4::IDENTITY, Vec3::NEG_Z);
    assert_eq!(seen(&gpu, &shadowed, BEHIND, dark()), BLACK);
}

#[test]
fn mirrored_instances_keep_their_outside() {
    let Some(gpu) = device() else { return };
    for double_sided in [0, MATERIAL_DOUBLE_SIDED] {
        let render = |model: Mat4, eye: Vec3| {
            let travel = Vec3::new(0.0, 0.0, -eye.z);
            seen(
                &gpu,
                &lit_square(white(double_sided), model, travel),
                eye,
                dark(),
            )
        };
        let reference = render(Mat4::IDENTITY, FRONT);
        for scale in [Vec3::new(-1.0, 1.0, 1.0), Vec3::new(1.0, -2.0, 0.5)] {
            let found = render(Mat4::from_scale(scale), FRONT);
            assert_near(found, reference, 1e-3);
        }
        // Mirrored along the normal, the square faces the other way.
        let turned = Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0));
        assert_near(render(turned, BEHIND), reference, 1e-3);
        let expected = if double_sided == 0 { BLACK } else { reference };
        assert_near(render(turned, FRONT), expected, 1e-3);
    }
}

#[test]
fn mirrored_and_plain_spheres_share_an_image() {
    let Some(gpu) = device() else { return };
    let (left, right) = (Vec3::new(-1.1, 0.0, 0.0), Vec3::new(1.1, 0.0, 0.0));
    let mirror = Mat4::from_translation(right) * Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let fixture = Fixture {
        objects: vec![sphere(0, vec![Mat4::from_translation(left), mirror])],
        materials: vec![white(0)],
        lights: vec![light(Vec3::new(0.0, -1.0, -1.0), [1.0; 3], 3.0)],
        ..Fixture::default()
    };
    let camera = towards_origin(Vec3::new(0.0, 0.0, 5.0));
    let image = shoot(&gpu, &fixture, [64, 32], camera, dark());
    assert_eq!(image.draws.draws, 2);
    for (x, y) in (0..32 * 32).map(|index| (index % 32, index / 32)) {
        let (plain, mirrored) = (super::texel(&image, x, y), super::texel(&image, 63 - x, y));
        assert_near(mirrored, plain, 0.02);
    }
}

/// x and y of a normal map's texel, and the unit normal that it stands for.
fn mapped_normal() -> ([u8; 4], Vec3) {
    let texel = [200, 90, 0, 255];
    let [x, y] = [texel[0], texel[1]].map(|channel| f32::from(channel) / 127.5 - 1.0);
    (texel, Vec3::new(x, y, (1.0 - x * x - y * y).sqrt()))
}

/// A square whose normal map holds one texel, seen as its normals.
fn normal_square(model: Mat4, handedness: f32, scale: f32) -> Fixture {
    let mut square = quad(0, vec![model]);
    for vertex in &mut square.vertices {
        vertex.tangent[3] = handedness;
    }
    Fixture {
        objects: vec![square],
        materials: vec![Material {
            normal_tex: 0,
            normal_scale: scale,
            ..white(MATERIAL_DOUBLE_SIDED)
        }],
        textures: vec![row(TextureFormat::Rgba8Unorm, vec![mapped_normal().0])],
        ..Fixture::default()
    }
}

#[test]
fn normal_maps_follow_rotation_scale_and_mirroring() {
    let Some(gpu) = device() else { return };
    let normals = Settings {
        debug_view: 4,
        ..plain()
    };
    let (_, mapped) = mapped_normal();
    let rotation = Quat::from_euler(glam::EulerRot::XYZ, 0.3, -0.5, 0.8);
    let linear_maps = [
        Mat4::IDENTITY,
        Mat4::from_quat(rotation),
        Mat4::from_quat(rotation) * Mat4::from_scale(Vec3::splat(1e-2)),
        Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0)),
        Mat4::from_scale(Vec3::new(1.0, -1.0, 1.0)),
        Mat4::from_quat(rotation) * Mat4::from_scale(Vec3::new(-2.0, 2.0, 2.0)),
    ];
    for model in linear_maps {
        for (handedness, eye) in [(1.0, FRONT), (-1.0, FRONT), (1.0, BEHIND)] {
            let object = mapped * Vec3::new(1.0, handedness, 1.0);
            let world = model.transform_vector3(object).normalize();
            let side = if eye == FRONT { world } else { -world };
            let expected = (side * 0.5 + 0.5).to_array();
            let square = normal_square(model, handedness, 1.0);
            let close = if model.determinant().abs() < 1e-3 {
                0.005
            } else {
                1.0
            };
            let found = seen(&gpu, &square, eye * close, normals.clone());
            assert_near(found, expected, 2e-3);
        }
    }
    // Stretched askew, the tangent follows the surface, which the normal matrix would not do.
    let skew = Mat4::from_scale(Vec3::new(3.0, 1.0, 0.5)) * Mat4::from_rotation_z(0.7);
    let tangent = skew.transform_vector3(Vec3::X).normalize();
    let frame = Mat3::from_cols(tangent, Vec3::Z.cross(tangent), Vec3::Z);
    let expected = (frame * mapped * 0.5 + 0.5).to_array();
    let stretched = normal_square(skew, 1.0, 1.0);
    assert_near(
        seen(&gpu, &stretched, FRONT, normals.clone()),
        expected,
        2e-3,
    );
    let half = (mapped * Vec3::new(0.5, 0.5, 1.0)).normalize() * 0.5 + 0.5;
    let scaled = normal_square(Mat4::IDENTITY, 1.0, 0.5);
    assert_near(seen(&gpu, &scaled, FRONT, normals), half.to_array(), 2e-3);
}

#[test]
fn degenerate_frames_fall_back() {
    let Some(gpu) = device() else { return };
    let normals = Settings {
        debug_view: 4,
        ..plain()
    };
    let expected = [0.5, 0.5, 1.0];
    let mut no_tangent = normal_square(Mat4::IDENTITY, 1.0, 1.0);
    for vertex in &mut no_tangent.objects[0].vertices {
        vertex.tangent = [0.0; 4];
    }
    assert_near(
        seen(&gpu, &no_tangent, FRONT, normals.clone()),
        expected,
        2e-3,
    );
    for vertex in &mut no_tangent.objects[0].vertices {
        vertex.normal = [0.0; 3];
    }
    assert_near(
        seen(&gpu, &no_tangent, FRONT, normals.clone()),
        expected,
        2e-3,
    );
    let behind = [0.5, 0.5, 0.0];
    assert_near(seen(&gpu, &no_tangent, BEHIND, normals), behind, 2e-3);
}

#[test]
fn the_mask_keeps_alpha_at_the_cutoff() {
    let Some(gpu) = device() else { return };
    for (cutoff, expected) in [(0.5, [1.0, 0.5, 0.25]), (0.500_001, BLACK)] {
        let fixture = Fixture {
            objects: vec![quad(0, vec![Mat4::IDENTITY])],
            materials: vec![Material {
                alpha_mode: ALPHA_MASK,
                alpha_cutoff: cutoff,
                ..unlit([1.0, 0.5, 0.25, 0.5])
            }],
            ..Fixture::default()
        };
        assert_near(seen(&gpu, &fixture, FRONT, plain()), expected, 1e-3);
    }
}

#[test]
fn blending_is_over_and_back_to_front() {
    let Some(gpu) = device() else { return };
    let blend = |color: [f32; 4], sides: u32| Material {
        alpha_mode: ALPHA_BLEND,
        double_sided: MATERIAL_UNLIT | sides,
        ..unlit(color)
    };
    let at = |z: f32| vec![Mat4::from_translation(Vec3::new(0.0, 0.0, z))];
    for sides in [0, MATERIAL_DOUBLE_SIDED] {
        let mut fixture = Fixture {
            // The nearest comes first in the package.
            objects: vec![quad(0, at(0.5)), quad(1, at(0.0)), quad(2, at(-0.5))],
            materials: vec![
                blend([1.0, 0.0, 0.0, 0.25], sides),
                blend([0.0, 1.0, 0.0, 0.5], sides),
                unlit([1.0; 4]),
            ],
            ..Fixture::default()
        };
        let expected = [0.5 * 0.75 + 0.25, 0.75, 0.5 * 0.75];
        assert_near(seen(&gpu, &fixture, FRONT, plain()), expected, 1e-3);
        fixture.objects[2] = quad(2, at(1.0));
        assert_near(seen(&gpu, &fixture, FRONT, plain()), [1.0; 3], 1e-3);
    }
}

#[test]
fn textures_decode_srgb_and_choose_coordinates() {
    let Some(gpu) = device() else { return };
    for (reference, expected) in [(0, [0.5029, 0.0, 0.0]), (TEXTURE_UV1, [0.0, 0.0331, 1.0])] {
        let fixture = Fixture {
            objects: vec![quad(0, vec![Mat4::IDENTITY])],
            materials: vec![Material {
                base_color_tex: reference,
                ..unlit([1.0; 4])
            }],
            textures: vec![row(
                TextureFormat::Rgba8Srgb,
                vec![[188, 0, 0, 255], [0, 51, 255, 255]],
            )],
            ..Fixture::default()
        };
        assert_near(seen(&gpu, &fixture, FRONT, plain()), expected, 1e-3);
    }
}

#[test]
fn occlusion_darkens_indirect_light_only() {
    let Some(gpu) = device() else { return };
    let fixture = |strength: f32, intensity: f32| Fixture {
        objects: vec![quad(0, vec![Mat4::IDENTITY])],
        materials: vec![Material {
            occlusion_tex: 0,
            occlusion_strength: strength,
            ..white(0)
        }],
        textures: vec![row(TextureFormat::Rgba8Unorm, vec![[51, 255, 255, 255]])],
        lights: vec![light(Vec3::NEG_Z, [1.0; 3], intensity)],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    // A white dielectric at roughness 1: its specular lobe is a small share, and multi-bounce holds for the rest.
    let [a, b, _] = super::twin::table(1.0, 1.0);
    let specular = (0.04 * a + b) * (1.0 + 0.04 * (1.0 / (a + b) - 1.0));
    for (strength, visibility) in [(0.0, 1.0), (1.0, 0.2), (0.5, 0.6)] {
        let diffuse = super::twin::multi_bounce(visibility, 1.0 - specular);
        let expected = (1.0 - specular) * diffuse + specular * visibility;
        let found = seen(&gpu, &fixture(strength, 0.0), FRONT, plain());
        assert_near(found, [expected as f32; 3], 2e-3);
    }
    let open = seen(&gpu, &fixture(0.0, 3.0), FRONT, dark());
    assert_near(seen(&gpu, &fixture(1.0, 3.0), FRONT, dark()), open, 1e-6);
}

/// No 8-bit stand-in for an absent map tilts the normal.
#[test]
fn without_a_normal_map_the_normal_is_exact() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![quad(0, vec![Mat4::IDENTITY])],
        materials: vec![white(0)],
        ..Fixture::default()
    };
    let settings = Settings {
        debug_view: 4,
        ..plain()
    };
    assert_eq!(seen(&gpu, &fixture, FRONT, settings), [0.5, 0.5, 1.0]);
}

/// A normal map may bend the normal beyond what the camera can see; it is then seen edge-on, and nothing overflows.
#[test]
fn normals_that_face_away_are_seen_edge_on() {
    let Some(gpu) = device() else { return };
    let tilted = Mat4::from_rotation_y(1.4);
    let fixture = Fixture {
        objects: vec![quad(0, vec![tilted])],
        materials: vec![Material {
            normal_tex: 0,
            roughness_factor: 0.0,
            ..Material::default()
        }],
        // x = -0.8 in tangent space, which lies along the world's -Z after the turn.
        textures: vec![row(TextureFormat::Rgba8Unorm, vec![[255, 128, 0, 255]])],
        lights: vec![light(Vec3::NEG_Z, [1.0; 3], 3.0)],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let settings = Settings {
        debug_view: 4,
        ..plain()
    };
    let camera = towards_origin(FRONT);
    let image = shoot(&gpu, &fixture, [33, 33], camera, settings);
    let normal = Vec3::from(super::middle(&image)) * 2.0 - 1.0;
    assert!(normal.z.abs() < 2e-3, "{normal} is edge-on along Z");
    // `shoot` asserts that lit texels are finite.
    let image = shoot(&gpu, &fixture, [33, 33], camera, plain());
    assert!(super::middle(&image)[0] <= 1.01);
}
