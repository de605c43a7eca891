//! Plans of materials.

use super::*;
use crate::scene::{Image, Lobes, Texture};
use glam::Vec3;

fn textured() -> Scene {
    let reference = |uv_set| Some(TextureRef::new(0, uv_set));
    Scene {
        images: vec![Image::default()],
        textures: vec![Texture {
            image: 0,
            sampler: None,
        }],
        materials: vec![Material {
            base_color_texture: reference(0),
            metallic_roughness_texture: reference(1),
            emissive_texture: reference(0),
            ..Material::default()
        }],
        ..Scene::default()
    }
}

#[test]
fn one_image_in_two_roles_is_encoded_twice() {
    let plan = plan(&textured(), &[Some(0)], false);
    assert_eq!(plan.images.len(), 2);
    assert_eq!(plan.samplers.len(), 1);
    assert_eq!(plan.materials[0].base_color_tex, 0);
    assert_eq!(
        plan.materials[0].metallic_roughness_tex,
        1 | gpu::TEXTURE_UV1
    );
    assert_eq!(plan.features, features::TEXTURES | features::UV1);
}

#[test]
fn channels_are_those_that_materials_read() {
    let mut scene = textured();
    scene.materials[0].occlusion_texture = Some(TextureRef::new(0, 0));
    let shared = plan(&scene, &[Some(0)], false);
    assert_eq!(
        shared.images.len(),
        2,
        "occlusion shares the image of the other data"
    );
    assert_eq!(shared.images[1].channels, RGB);
    assert!(shared.companions.is_empty());
    scene.images.push(Image::default());
    scene.textures.push(Texture {
        image: 1,
        sampler: None,
    });
    scene.materials[0].occlusion_texture = Some(TextureRef::new(1, 0));
    let apart = plan(&scene, &[Some(0)], false);
    let channels: Vec<u8> = apart.images.iter().map(|image| image.channels).collect();
    assert_eq!(channels, [RGB, GREEN | BLUE, RED]);
    assert_eq!(apart.companions, [[2, 1]]);
    // A second companion of the same image leaves no pair.
    scene.images.push(Image::default());
    scene.textures.push(Texture {
        image: 2,
        sampler: None,
    });
    let mut other = scene.materials[0].clone();
    other.occlusion_texture = Some(TextureRef::new(2, 0));
    scene.materials.push(other);
    assert!(
        plan(&scene, &[Some(0), Some(1)], false)
            .companions
            .is_empty()
    );
}

#[test]
fn textures_without_effect_are_left_out() {
    let mut scene = textured();
    assert_eq!(
        plan(&scene, &[Some(0)], false).materials[0].emissive_tex,
        gpu::NO_TEXTURE
    );
    scene.materials[0].emissive = Vec3::ONE;
    assert_eq!(plan(&scene, &[Some(0)], false).materials[0].emissive_tex, 0);
    scene.materials[0].unlit = true;
    let unlit = plan(&scene, &[Some(0)], false);
    assert_eq!(unlit.images.len(), 1);
    assert_eq!(unlit.materials[0].double_sided, gpu::MATERIAL_UNLIT);
}

#[test]
fn transforms_make_slots_of_their_own() {
    let mut scene = textured();
    assert!(plan(&scene, &[Some(0)], false).transforms.is_empty());
    let turned = UvTransform::new([0.5, 0.0], 1.0, [2.0, -1.0]);
    let mut moved = scene.materials[0].clone();
    for reference in [
        &mut moved.base_color_texture,
        &mut moved.metallic_roughness_texture,
    ] {
        reference.as_mut().expect("textured").transform = turned;
    }
    scene.materials.push(moved);
    let plan = plan(&scene, &[Some(0), Some(1)], false);
    assert_eq!(plan.images.len(), 2, "the mip filter ignores the transform");
    assert_eq!((plan.slots.len(), plan.transforms.len()), (4, 4));
    assert_eq!(plan.materials[1].base_color_tex, 2);
    assert_eq!(
        plan.materials[1].metallic_roughness_tex,
        3 | gpu::TEXTURE_UV1
    );
    assert_eq!(plan.transforms[1].matrix, [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(plan.transforms[2].matrix, turned.matrix);
    assert_eq!(plan.transforms[3].offset, [0.5, 0.0]);
    assert!(plan.features & features::TEXTURE_TRANSFORMS != 0);
}

#[test]
fn lobes_have_records_where_a_material_uses_one() {
    let mut scene = textured();
    scene.materials[0].metallic = 0.0;
    scene.materials.push(scene.materials[0].clone());
    assert!(
        plan(&scene, &[Some(0), Some(1)], false)
            .extensions
            .is_empty()
    );
    let texture = Some(TextureRef::new(0, 0));
    scene.materials[1].lobes = Lobes {
        specular: 0.5,
        specular_texture: texture,
        specular_color_texture: texture,
        clearcoat_texture: texture,
        ior: 0.0,
        ..Lobes::default()
    };
    let plan = plan(&scene, &[Some(0), Some(1)], false);
    assert_eq!(plan.extensions.len(), 2);
    assert_eq!(plan.extensions[0], gpu::MaterialExtension::default());
    let record = plan.extensions[1];
    assert_eq!(record.lobes, gpu::LOBE_SPECULAR);
    assert_eq!((record.specular_factor, record.dielectric_f0), (0.5, 1.0));
    assert_eq!(record.clearcoat_tex, gpu::NO_TEXTURE);
    let image = |slot: u32| plan.images[plan.slots[slot as usize].image as usize];
    let specular = image(record.specular_tex);
    assert_eq!(
        (specular.role, specular.alpha),
        (Role::Data, AlphaUse::Value)
    );
    assert_eq!(record.specular_color_tex, plan.materials[0].base_color_tex);
}

#[test]
fn indices_of_refraction_give_their_reflectance() {
    for (ior, expected) in [(1.5, 0.04), (1.0, 0.0), (0.0, 1.0), (2.0, 1.0 / 9.0)] {
        assert_eq!(dielectric_f0(ior), expected as f32, "{ior}");
    }
}

#[test]
fn the_default_material_has_no_texture() {
    let plan = plan(&Scene::default(), &[None], false);
    assert!(plan.images.is_empty() && plan.slots.is_empty());
    assert_eq!(plan.materials[0], gpu::Material::default());
}

/// A bumpy material: normals of image 1, roughness of image 0.
fn bumpy() -> Scene {
    let mut scene = textured();
    scene.images.push(Image::default());
    scene.textures.push(Texture {
        image: 1,
        sampler: None,
    });
    let material = &mut scene.materials[0];
    material.metallic_roughness_texture = Some(TextureRef::new(0, 0));
    material.occlusion_texture = Some(TextureRef::new(0, 0));
    material.normal_texture = Some(TextureRef::new(1, 0));
    material.normal_scale = 0.5;
    material.roughness = 0.75;
    scene
}

#[test]
fn normals_widen_roughness_where_asked() {
    let scene = bumpy();
    let plain = plan(&scene, &[Some(0)], false);
    assert!(plain.images.iter().all(|image| image.widening.is_none()));
    assert_eq!(plain.materials[0].roughness_factor, 0.75);
    let widened = plan(&scene, &[Some(0)], true);
    assert_eq!(widened.images.len(), plain.images.len());
    let image = |slot: u32| widened.images[widened.slots[slot as usize].image as usize];
    let record = widened.materials[0];
    let roughness = image(record.metallic_roughness_tex);
    let expected = Widening {
        normal: 1,
        normal_wrap: [Wrap::Repeat; 2],
        normal_scale: 0.5,
        factor: 0.75,
        textured: true,
    };
    assert_eq!(roughness.widening, Some(expected));
    assert_eq!((roughness.image, roughness.channels), (0, RGB));
    // Occlusion of the same image stays in it.
    assert_eq!(record.occlusion_tex, record.metallic_roughness_tex);
    assert_eq!(record.roughness_factor, 1.0);
    assert_eq!(image(record.base_color_tex).widening, None);
    assert!(widened.unpaired.is_empty());
}

#[test]
fn materials_without_a_roughness_texture_get_one() {
    let mut scene = bumpy();
    scene.images[1].name = "bumps".into();
    scene.materials[0].metallic_roughness_texture = None;
    let plain = plan(&scene, &[Some(0)], false);
    assert_eq!(plain.materials[0].metallic_roughness_tex, gpu::NO_TEXTURE);
    let widened = plan(&scene, &[Some(0)], true);
    let record = widened.materials[0];
    let slot = widened.slots[record.metallic_roughness_tex as usize];
    let image = widened.images[slot.image as usize];
    assert_eq!((image.image, image.role), (1, Role::Data));
    assert!(image.widening.is_some_and(|widening| !widening.textured));
    assert_eq!(image.name(&scene), "roughness of bumps");
    assert_ne!(slot.image, widened.slots[record.normal_tex as usize].image);
    // What is as rough as can be, or flat, needs none.
    for change in [
        |material: &mut Material| material.roughness = 1.0,
        |material: &mut Material| material.normal_scale = 0.0,
        |material: &mut Material| material.normal_texture = None,
    ] {
        let mut scene = scene.clone();
        change(&mut scene.materials[0]);
        let plan = plan(&scene, &[Some(0)], true);
        assert_eq!(plan.materials[0].metallic_roughness_tex, gpu::NO_TEXTURE);
    }
}

#[test]
fn other_coordinates_are_named_and_left() {
    let mut scene = bumpy();
    scene.materials[0].normal_texture = Some(TextureRef::new(1, 1));
    let apart = plan(&scene, &[Some(0)], true);
    assert_eq!(apart.unpaired, [0]);
    assert_eq!(apart.materials[0].roughness_factor, 0.75);
    assert!(apart.images.iter().all(|image| image.widening.is_none()));
    assert!(plan(&scene, &[Some(0)], false).unpaired.is_empty());
}

#[test]
fn coats_have_normals_of_their_own() {
    let mut scene = bumpy();
    scene.materials[0].lobes = Lobes {
        clearcoat: 1.0,
        clearcoat_roughness: 0.25,
        clearcoat_normal_texture: Some(TextureRef::new(1, 0)),
        ..Lobes::default()
    };
    let plan = plan(&scene, &[Some(0)], true);
    let coat = plan.extensions[0];
    assert_eq!(coat.clearcoat_roughness, 1.0);
    let slot = plan.slots[coat.clearcoat_roughness_tex as usize];
    let widening = plan.images[slot.image as usize].widening.expect("widened");
    assert_eq!((widening.factor, widening.normal_scale), (0.25, 1.0));
}
