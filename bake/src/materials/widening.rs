//! Which normals widen which roughness.

use super::{ImageUse, Widening};
use crate::scene::{Sampler, Scene, TextureRef};

/// A roughness and the normals of the same layer of a material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layer {
    pub normal: Option<TextureRef>,
    pub normal_scale: f32,
    /// Roughness in green.
    pub roughness: Option<TextureRef>,
    pub factor: f32,
}

impl Layer {
    /// Whether normals and roughness are read at different coordinates.
    pub fn is_unpaired(&self) -> bool {
        self.normal_scale != 0.0
            && matches!((self.normal, self.roughness), (Some(normal), Some(roughness))
                if !alike(normal, roughness))
    }

    /// The texture to read roughness of, and how normals widen it; `None` where they do not.
    pub fn widening(&self, scene: &Scene) -> Option<(TextureRef, Widening)> {
        let normal = self.normal.filter(|_| self.normal_scale != 0.0)?;
        let widest = self.roughness.is_none() && self.factor >= 1.0;
        if widest || self.is_unpaired() {
            return None;
        }
        let texture = scene.textures[normal.texture as usize];
        let sampler = sampler(scene, normal);
        let widening = Widening {
            normal: texture.image,
            normal_wrap: [sampler.wrap_u, sampler.wrap_v],
            normal_scale: self.normal_scale,
            factor: self.factor,
            textured: self.roughness.is_some(),
        };
        Some((self.roughness.unwrap_or(normal), widening))
    }
}

/// Whether two textures are read at the same coordinates.
pub(super) fn alike(one: TextureRef, other: TextureRef) -> bool {
    (one.uv_set, one.transform) == (other.uv_set, other.transform)
}

/// How a texture is sampled.
pub(super) fn sampler(scene: &Scene, reference: TextureRef) -> Sampler {
    let texture = scene.textures[reference.texture as usize];
    texture
        .sampler
        .map_or_else(Sampler::default, |index| scene.samplers[index as usize])
}

impl ImageUse {
    /// What messages and packages call the image.
    pub fn name(&self, scene: &Scene) -> String {
        let name = &scene.images[self.image as usize].name;
        match self.widening {
            Some(widening) if !widening.textured => format!("roughness of {name}"),
            _ => name.clone(),
        }
    }
}
