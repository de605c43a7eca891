//! Materials of the hall.

use serde_json::{Value, json};

use crate::gltf::{Builder, Material};

/// Handles of the hall's materials.
#[derive(Debug)]
pub struct Palette {
    pub floor: Material,
    pub wall: Material,
    pub limestone: Material,
    pub marble: Material,
    pub wood: Material,
    /// Red, ochre, blue.
    pub cloth: [Material; 3],
    pub carpet: Material,
    pub leaf: Material,
    pub terracotta: Material,
    pub soil: Material,
    pub bronze: Material,
    pub lamp: Material,
    pub brushed: Material,
    /// Gold, copper and steel in order of growing roughness.
    pub metals: [Material; 7],
    pub dielectrics: [Material; 6],
    pub glass: [Material; 3],
}

fn factors(color: [f64; 3], alpha: f64, metallic: f64, roughness: f64) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [color[0], color[1], color[2], alpha],
        "metallicFactor": metallic, "roughnessFactor": roughness}})
}

fn solid(color: [f64; 3], metallic: f64, roughness: f64) -> Value {
    factors(color, 1.0, metallic, roughness)
}

/// Measured normal-incidence reflectances in linear sRGB.
const GOLD: [f64; 3] = [1.0, 0.766, 0.336];
const COPPER: [f64; 3] = [0.955, 0.637, 0.538];
const STEEL: [f64; 3] = [0.56, 0.57, 0.58];

impl Palette {
    pub fn new(scene: &mut Builder) -> Self {
        let texture =
            |scene: &mut Builder, name: &str| scene.texture(name, &format!("textures/{name}.png"));
        let leaf = texture(scene, "leaf");
        let brushed = texture(scene, "brushed_orm");
        let [floor, wall] = stone_pair(scene, texture);
        let limestone_maps = ["limestone_color", "limestone_normal"].map(|n| texture(scene, n));
        let cloth_maps = ["cloth_color", "cloth_normal"].map(|n| texture(scene, n));
        let carpet_map = texture(scene, "carpet_color");
        let stone = |tint: [f64; 3], roughness: f64| {
            let mut m = solid(tint, 0.0, roughness);
            m["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": limestone_maps[0]});
            m["normalTexture"] = json!({"index": limestone_maps[1]});
            m
        };
        let weave = |tint: [f64; 3], color: usize| {
            let mut m = solid(tint, 0.0, 0.88);
            m["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": color});
            m["normalTexture"] = json!({"index": cloth_maps[1], "scale": 0.7});
            m["doubleSided"] = json!(true);
            m
        };
        let cloth = [
            ("red cloth", [0.62, 0.035, 0.03]),
            ("ochre cloth", [0.78, 0.40, 0.07]),
            ("blue cloth", [0.035, 0.12, 0.48]),
        ]
        .map(|(name, tint)| scene.material(name, weave(tint, cloth_maps[0])));
        Self {
            floor,
            wall,
            limestone: scene.material("limestone", stone([1.0, 0.95, 0.87], 0.8)),
            marble: scene.material("white marble", stone([1.0, 1.0, 1.0], 0.32)),
            wood: scene.material("wood", solid([0.20, 0.105, 0.05], 0.0, 0.65)),
            cloth,
            carpet: scene.material("carpet", weave([1.0, 1.0, 1.0], carpet_map)),
            leaf: scene.material("leaf", leaf_fields(leaf)),
            terracotta: scene.material("terracotta", solid([0.55, 0.20, 0.10], 0.0, 0.75)),
            soil: scene.material("soil", solid([0.05, 0.033, 0.022], 0.0, 1.0)),
            bronze: scene.material("bronze", solid([0.42, 0.26, 0.12], 1.0, 0.35)),
            lamp: scene.material("lamp", lamp_fields()),
            brushed: scene.material("brushed steel", {
                let mut m = solid([0.75, 0.74, 0.72], 1.0, 1.0);
                m["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({"index": brushed});
                m["occlusionTexture"] = json!({"index": brushed});
                m
            }),
            metals: metals(scene),
            dielectrics: dielectrics(scene),
            glass: glass(scene),
        }
    }
}

fn stone_pair(scene: &mut Builder, texture: impl Fn(&mut Builder, &str) -> usize) -> [Material; 2] {
    ["floor", "wall"].map(|name| {
        let maps = ["color", "normal", "orm"].map(|role| texture(scene, &format!("{name}_{role}")));
        scene.material(
            name,
            json!({
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": maps[0]},
                    "metallicRoughnessTexture": {"index": maps[2]}},
                "normalTexture": {"index": maps[1]},
                "occlusionTexture": {"index": maps[2]}
            }),
        )
    })
}

fn leaf_fields(texture: usize) -> Value {
    json!({
        "alphaCutoff": 0.5, "alphaMode": "MASK", "doubleSided": true,
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": texture}, "metallicFactor": 0.0, "roughnessFactor": 0.55}
    })
}

fn lamp_fields() -> Value {
    json!({
        "emissiveFactor": [1.0, 0.68, 0.34],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 12.0}},
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.9, 0.85, 0.75, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.4}
    })
}

fn metals(scene: &mut Builder) -> [Material; 7] {
    [
        ("gold 0.05", GOLD, 0.05),
        ("copper 0.15", COPPER, 0.15),
        ("steel 0.25", STEEL, 0.25),
        ("gold 0.4", GOLD, 0.4),
        ("copper 0.6", COPPER, 0.6),
        ("steel 0.8", STEEL, 0.8),
        ("gold 1.0", GOLD, 1.0),
    ]
    .map(|(name, color, roughness)| scene.material(name, solid(color, 1.0, roughness)))
}

fn dielectrics(scene: &mut Builder) -> [Material; 6] {
    [
        ("white glaze 0.05", [0.82, 0.80, 0.76], 0.05),
        ("red lacquer 0.15", [0.55, 0.03, 0.025], 0.15),
        ("green glaze 0.3", [0.05, 0.30, 0.16], 0.3),
        ("blue matt 0.5", [0.05, 0.13, 0.50], 0.5),
        ("black lacquer 0.1", [0.015, 0.015, 0.018], 0.1),
        ("plaster 1.0", [0.80, 0.77, 0.72], 1.0),
    ]
    .map(|(name, color, roughness)| scene.material(name, solid(color, 0.0, roughness)))
}

fn glass(scene: &mut Builder) -> [Material; 3] {
    [
        ("red glass", [0.75, 0.05, 0.04]),
        ("amber glass", [0.85, 0.45, 0.03]),
        ("blue glass", [0.03, 0.22, 0.70]),
    ]
    .map(|(name, color)| {
        let mut m = factors(color, 0.28, 0.0, 0.06);
        m["alphaMode"] = json!("BLEND");
        m["doubleSided"] = json!(true);
        scene.material(name, m)
    })
}
