//! Packages with right hashes and wrong content: each rule refuses its violation.

use crate::common::{Content, package, tiny};
use bytemuck::Zeroable;
use cairn_format::gpu::{MaterialExtension, NO_TEXTURE, PunctualLight, TEXTURE_UV1};
use cairn_format::scene::{Camera, ProjectionKind, Scene};
use cairn_format::{Package, Result};

fn open(change: impl FnOnce(&mut Scene, &mut Content)) -> Result<Package> {
    let (mut scene, mut content) = tiny();
    change(&mut scene, &mut content);
    Package::from_bytes(&package(&scene, &content))
}

/// Refused by `open` with `what` in the message.
#[track_caller]
fn refused(what: &str, change: impl FnOnce(&mut Scene, &mut Content)) {
    let error = open(change).expect_err(what).to_string();
    assert!(error.contains(what), "`{error}` does not say `{what}`");
}

/// Accepted by `open`, refused by `verify` with `what` in the message.
#[track_caller]
fn unsound(what: &str, change: impl FnOnce(&mut Scene, &mut Content)) {
    let package = open(change).expect("open reads no bulk data");
    let error = package.verify().expect_err(what).to_string();
    assert!(error.contains(what), "`{error}` does not say `{what}`");
}

#[test]
fn ranges_of_the_root_are_checked() {
    refused("primitives 0+2", |scene, _| {
        scene.meshes[0].primitive_count = 2
    });
    refused("primitives 4294967295+1", |scene, _| {
        scene.meshes[0].first_primitive = u32::MAX
    });
    refused("indices 0+6", |scene, _| {
        scene.primitives[0].index_count = 6
    });
    refused("indices 0+2", |scene, _| {
        scene.primitives[0].index_count = 2
    });
    refused("6 traced indices", |scene, _| {
        scene.primitives[0].traced_index_count = 6
    });
    refused("vertices 1+3", |scene, _| {
        scene.primitives[0].first_vertex = 1
    });
    refused("material 1 of 1", |scene, _| {
        scene.primitives[0].material = 1
    });
    refused("bounds", |scene, _| {
        scene.primitives[0].bounds.min[1] = f32::NAN
    });
    refused("scene bounds", |scene, _| scene.bounds.min[0] = 7.0);
    refused("unknown feature", |scene, _| scene.features = 1 << 31);
    refused("material names", |scene, _| scene.materials.clear());
}

#[test]
fn images_and_textures_are_checked() {
    refused("0 x 1 texels", |scene, _| scene.images[0].width = 0);
    refused("70000 x 1 texels", |scene, _| {
        scene.images[0].width = 70_000
    });
    refused("level 0", |scene, _| scene.images[0].width = 3);
    refused("2 layers", |scene, _| scene.images[0].layers = 2);
    refused("6 layers", |scene, _| scene.images[0].layers = 6);
    refused("0 levels", |scene, _| scene.images[0].levels.clear());
    refused("3 levels", |scene, _| {
        let last = scene.images[0].levels[1].clone();
        scene.images[0].levels.push(last);
    });
    refused("level 1", |scene, _| scene.images[0].levels[1].offset = 8);
    refused("level 1", |scene, _| {
        scene.images[0].levels[1].offset = u64::MAX - 15
    });
    refused("image 1", |scene, _| scene.textures[0].image = 1);
    refused("sampler 1", |scene, _| scene.textures[0].sampler = 1);
    refused("BRDF table", |scene, _| scene.brdf_lut = Some(9));
}

#[test]
fn cameras_are_finite() {
    refused("camera 0 `c`", |scene, _| {
        scene.cameras.push(Camera {
            name: "c".into(),
            projection: ProjectionKind::Perspective,
            extent: f32::INFINITY,
            znear: 0.1,
            zfar: 0.0,
            position: [0.0; 3],
            forward: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
        });
    });
}

#[test]
fn materials_and_draws_are_checked() {
    refused("texture reference", |_, content| {
        content.materials[0].normal_tex = 1
    });
    refused("texture reference", |_, content| {
        content.materials[0].normal_tex = TEXTURE_UV1 | 1
    });
    open(|_, content| content.materials[0].normal_tex = TEXTURE_UV1).expect("slot 0 with uv1");
    open(|_, content| content.materials[0].base_color_tex = NO_TEXTURE).expect("no texture");
    refused("alpha mode 3", |_, content| {
        content.materials[0].alpha_mode = 3
    });
    refused("flags", |_, content| content.materials[0].double_sided = 4);
    refused("not finite", |_, content| {
        content.materials[0].roughness_factor = f32::NAN
    });
    refused("primitive 1 of 1", |_, content| {
        content.draw_groups[0].primitive = 1
    });
    refused("ranges differ", |_, content| {
        content.draw_groups[0].index_count = 0
    });
    refused("instances 1+1", |_, content| {
        content.draw_groups[0].first_instance = 1
    });
    refused("alpha mode 5", |_, content| {
        content.draw_groups[0].alpha_mode = 5
    });
    refused("flags 0x4", |_, content| content.draw_groups[0].flags = 4);
    refused("floats do not fit", |_, content| {
        content.bounds.truncate(16)
    });
}

#[test]
fn lights_and_lobes_are_checked() {
    let light = PunctualLight::zeroed();
    open(|_, content| content.punctual_lights = vec![light; 3]).expect("sound lights");
    refused("light 1 is not finite", |_, content| {
        content.punctual_lights = vec![light; 3];
        content.punctual_lights[1].spot_offset = f32::NAN;
    });
    let lobes = MaterialExtension::default();
    open(|_, content| content.material_extensions = vec![lobes]).expect("sound lobes");
    refused("2 records, not 1", |_, content| {
        content.material_extensions = vec![lobes; 2]
    });
    let refuse = |what: &str, change: fn(&mut MaterialExtension)| {
        refused(what, |_, content| {
            content.material_extensions = vec![lobes];
            change(&mut content.material_extensions[0]);
        });
    };
    refuse("texture reference", |lobes| lobes.clearcoat_normal_tex = 1);
    refuse("texture reference", |lobes| {
        lobes.sheen_roughness_tex = TEXTURE_UV1 | 1
    });
    refuse("lobes 0x8", |lobes| lobes.lobes = 8);
    refuse("not finite", |lobes| lobes.sheen_color[2] = f32::INFINITY);
    refuse("not finite", |lobes| lobes.dielectric_f0 = f32::NAN);
}

#[test]
fn bulk_data_is_verified() {
    unsound("index 3 of a primitive", |_, content| {
        content.indices[1] = 3
    });
    unsound("vertex 2 is not finite", |_, content| {
        content.vertices[2].uv0[0] = f32::INFINITY
    });
    unsound("material 1 of 1", |_, content| {
        content.instances[0].material_index = 1
    });
    unsound("matrix", |_, content| {
        content.instances[0].model[3][0] = f32::NAN
    });
    unsound("mesh 1 of 1", |_, content| {
        content.mesh_instances[0].mesh = 1
    });
    unsound("first geometry", |_, content| {
        content.mesh_instances[0].first_geometry = 1
    });
    unsound("bounds of instance 0", |_, content| {
        content.bounds[0] = f32::NAN
    });
}
