//! Walks the node hierarchy: world transforms, mesh instances, lights and cameras.

use std::collections::BTreeMap;

use glam::{DMat4, DQuat, DVec3, DVec4};
use gltf::json;

use crate::diagnostic::Result;
use crate::scene::{Camera, Light, MeshInstance};

use super::camera::CameraNames;
use super::context::Context;
use super::{camera, instancing, light, mesh};

/// The most instances that one scene may have.
const INSTANCE_LIMIT: usize = 1 << 20;

/// A mesh in its default pose; instances of one shape share it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Shape {
    /// glTF index.
    pub mesh: u32,
    /// glTF index of the skin; the vertices then are in the world.
    pub skin: Option<u32>,
    /// Bits of the morph weights, empty where all are zero.
    weights: Vec<u32>,
}

impl Shape {
    /// The weights of the morph targets, empty where all are zero.
    pub fn weights(&self) -> Vec<f32> {
        self.weights
            .iter()
            .map(|&bits| f32::from_bits(bits))
            .collect()
    }
}

/// What the nodes of the scene place in the world, in depth-first order.
#[derive(Default)]
pub(super) struct Placed {
    /// `mesh` is an index into `shapes`.
    pub instances: Vec<MeshInstance>,
    /// In the order of their first instances.
    pub shapes: Vec<Shape>,
    numbers: BTreeMap<Shape, u32>,
    /// World transforms of all nodes where a skin needs them, else of those in the scene.
    pub worlds: Vec<DMat4>,
    pub lights: Vec<Light>,
    pub cameras: Vec<Camera>,
}

/// A quaternion further from unit length than this is reported. Exporters round to about 1e-7.
const UNIT_TOLERANCE: f64 = 1e-3;

/// Places everything that the default scene (else scene 0, else all root nodes) reaches.
///
/// # Errors
/// A hierarchy that is no forest, a missing index, or a transform that is not finite.
pub(super) fn place(context: &Context) -> Result<Placed> {
    let parents = parents(context)?;
    let roots = roots(context, &parents)?;
    let nodes = &context.document.nodes;
    let mut placed = Placed::default();
    let mut worlds = vec![None; nodes.len()];
    let mut names = CameraNames::default();
    let mut stack: Vec<(usize, DMat4)> =
        roots.iter().rev().map(|&r| (r, DMat4::IDENTITY)).collect();
    while let Some((index, parent)) = stack.pop() {
        let node = &nodes[index];
        let world = world(context, index, node, parent)?;
        worlds[index] = Some(world);
        if let Some(mesh) = node.mesh {
            placed.add(context, index, mesh.value(), world)?;
        }
        placed
            .lights
            .extend(light::read(context, index, node, &world)?);
        placed
            .cameras
            .extend(camera::read(context, index, node, &world, &mut names)?);
        let children = node.children.as_deref().unwrap_or_default();
        stack.extend(children.iter().rev().map(|child| (child.value(), world)));
    }
    if placed.shapes.iter().any(|shape| shape.skin.is_some()) {
        place_rest(context, &parents, &mut worlds)?;
    }
    let or_identity = |world: Option<DMat4>| world.unwrap_or_default();
    placed.worlds = worlds.into_iter().map(or_identity).collect();
    Ok(placed)
}

/// World transforms of the nodes outside the scene, where joints may be.
fn place_rest(
    context: &Context,
    parents: &[Option<usize>],
    worlds: &mut [Option<DMat4>],
) -> Result<()> {
    let nodes = &context.document.nodes;
    let unplaced = |&index: &usize| parents[index].is_none() && worlds[index].is_none();
    let roots = (0..nodes.len()).filter(unplaced);
    let mut stack: Vec<(usize, DMat4)> = roots.map(|root| (root, DMat4::IDENTITY)).collect();
    while let Some((index, parent)) = stack.pop() {
        let world = world(context, index, &nodes[index], parent)?;
        worlds[index] = Some(world);
        let children = nodes[index].children.as_deref().unwrap_or_default();
        stack.extend(children.iter().map(|child| (child.value(), world)));
    }
    Ok(())
}

/// The node's name, else `node N`.
pub(super) fn name(index: usize, node: &json::Node) -> String {
    node.name.clone().unwrap_or_else(|| format!("node {index}"))
}

impl Placed {
    /// Places the mesh of a node, once or by the instances of `EXT_mesh_gpu_instancing`.
    fn add(&mut self, context: &Context, index: usize, mesh: usize, world: DMat4) -> Result<()> {
        let node = &context.document.nodes[index];
        let meshes = context.document.meshes.len();
        if mesh >= meshes {
            let pointer = format!("/nodes/{index}/mesh");
            return Err(context.absent(pointer, "mesh", mesh, meshes));
        }
        let limit = INSTANCE_LIMIT.saturating_sub(self.instances.len());
        let locals = instancing::read(context, index, node, limit)?;
        let shape = shape(context, index, mesh)?;
        let skinned = shape.skin.is_some();
        let next = self.shapes.len() as u32;
        let number = *self.numbers.entry(shape.clone()).or_insert(next);
        if number == next {
            self.shapes.push(shape);
        }
        let mut push = |name: String, world: DMat4| {
            let mesh = number;
            self.instances.push(MeshInstance { name, mesh, world });
        };
        let name = name(index, node);
        match locals {
            // Only the joints place a skinned mesh.
            _ if skinned => push(name, DMat4::IDENTITY),
            None => push(name, world),
            Some(locals) => {
                for (instance, local) in locals.into_iter().enumerate() {
                    let world = finite(context, index, world * local)?;
                    push(format!("{name} #{instance}"), world);
                }
            }
        }
        Ok(())
    }
}

fn shape(context: &Context, index: usize, mesh: usize) -> Result<Shape> {
    let node = &context.document.nodes[index];
    let json = &context.document.meshes[mesh];
    let weights = node.weights.as_ref().or(json.weights.as_ref());
    let weights = weights.map_or(&[][..], Vec::as_slice);
    if !weights.iter().all(|weight| weight.is_finite()) {
        let message = "a morph weight is not finite; correct it";
        let pointer = format!("/nodes/{index}");
        return Err(context.error("morph-weight", pointer, message));
    }
    let neutral = weights.iter().all(|&weight| weight == 0.0);
    let mut skin = node.skin.as_ref().map(|skin| skin.value() as u32);
    if skin.is_some() && !mesh::is_skinnable(json) {
        let message = "the mesh has no JOINTS_0 and WEIGHTS_0, so its skin is left out";
        context.warn("skin-attributes", format!("/nodes/{index}/skin"), message);
        skin = None;
    }
    Ok(Shape {
        mesh: mesh as u32,
        skin,
        weights: match neutral {
            true => Vec::new(),
            false => weights.iter().map(|weight| weight.to_bits()).collect(),
        },
    })
}

/// The parent of every node, once it is certain that the nodes form a forest.
fn parents(context: &Context) -> Result<Vec<Option<usize>>> {
    let nodes = &context.document.nodes;
    let children = |index: usize| nodes[index].children.as_deref().unwrap_or_default();
    let mut parents = vec![None; nodes.len()];
    for index in 0..nodes.len() {
        for (ordinal, child) in children(index).iter().enumerate() {
            let pointer = || format!("/nodes/{index}/children/{ordinal}");
            let Some(parent) = parents.get_mut(child.value()) else {
                return Err(context.absent(pointer(), "node", child.value(), nodes.len()));
            };
            if let Some(other) = parent.replace(index) {
                let message = format!(
                    "node {} is already a child of node {other}; a node can have one parent, so copy it",
                    child.value()
                );
                return Err(context.error("node-shared", pointer(), message));
            }
        }
    }
    // With one parent each, what no root reaches is on a cycle or below one.
    let mut reached = vec![false; nodes.len()];
    let is_root = |&index: &usize| parents[index].is_none();
    let mut stack: Vec<usize> = (0..nodes.len()).filter(is_root).collect();
    while let Some(index) = stack.pop() {
        reached[index] = true;
        stack.extend(children(index).iter().map(|child| child.value()));
    }
    match reached.iter().position(|reached| !reached) {
        None => Ok(parents),
        Some(index) => {
            let message = "the node is below itself; remove the cycle of children";
            Err(context.error("node-cycle", format!("/nodes/{index}"), message))
        }
    }
}

/// The root nodes to start from.
fn roots(context: &Context, parents: &[Option<usize>]) -> Result<Vec<usize>> {
    let scenes = &context.document.scenes;
    let scene = match context.document.scene {
        Some(index) if index as usize >= scenes.len() => {
            return Err(context.absent("/scene", "scene", index as usize, scenes.len()));
        }
        Some(index) => index as usize,
        None if scenes.is_empty() => {
            let is_root = |&index: &usize| parents[index].is_none();
            return Ok((0..parents.len()).filter(is_root).collect());
        }
        None => 0,
    };
    let mut listed = vec![false; parents.len()];
    let mut roots = Vec::new();
    for (ordinal, &node) in scenes[scene].nodes.iter().enumerate() {
        let index = node as usize;
        let pointer = format!("/scenes/{scene}/nodes/{ordinal}");
        let Some(parent) = parents.get(index) else {
            return Err(context.absent(pointer, "node", index, parents.len()));
        };
        if let Some(parent) = parent {
            let message = format!(
                "node {index} is a child of node {parent}, so it is no root; remove it from the scene"
            );
            return Err(context.error("node-shared", pointer, message));
        }
        if std::mem::replace(&mut listed[index], true) {
            let message = format!("node {index} is listed twice; remove one");
            return Err(context.error("node-shared", pointer, message));
        }
        roots.push(index);
    }
    Ok(roots)
}

fn world(context: &Context, index: usize, node: &json::Node, parent: DMat4) -> Result<DMat4> {
    finite(context, index, parent * local(context, index, node))
}

fn finite(context: &Context, index: usize, world: DMat4) -> Result<DMat4> {
    if world.is_finite() {
        return Ok(world);
    }
    let message = "the node's world transform is not finite; correct its matrix, translation, \
                   rotation or scale, or those of its parents";
    Err(context.error("non-finite-transform", format!("/nodes/{index}"), message))
}

/// The node's own transform, in f64.
fn local(context: &Context, index: usize, node: &json::Node) -> DMat4 {
    let pointer = || format!("/nodes/{index}");
    let parts = node.translation.is_some() || node.rotation.is_some() || node.scale.is_some();
    if let Some(matrix) = &node.matrix {
        if parts {
            let message =
                "the node has a matrix beside translation, rotation or scale; the matrix is used";
            context.warn("node-transform", pointer(), message);
        }
        let mut matrix = DMat4::from_cols_array(&matrix.map(f64::from));
        if matrix.row(3) != DVec4::W {
            let message = "the bottom row of the matrix is not 0 0 0 1 and is taken to be";
            context.warn("node-matrix-projective", pointer(), message);
            matrix = DMat4::from_cols(
                matrix.x_axis.truncate().extend(0.0),
                matrix.y_axis.truncate().extend(0.0),
                matrix.z_axis.truncate().extend(0.0),
                matrix.w_axis.truncate().extend(1.0),
            );
        }
        return matrix;
    }
    let vector = |value: Option<[f32; 3]>, default| {
        value.map_or(default, |value| DVec3::from_array(value.map(f64::from)))
    };
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |rotation| {
        unit_quaternion(context, rotation.0, pointer)
    });
    DMat4::from_scale_rotation_translation(
        vector(node.scale, DVec3::ONE),
        rotation,
        vector(node.translation, DVec3::ZERO),
    )
}

/// The rotation of a quaternion, with a warning where that is not of unit length.
pub(super) fn unit_quaternion(
    context: &Context,
    value: [f32; 4],
    pointer: impl Fn() -> String,
) -> DQuat {
    let quaternion = DVec4::from_array(value.map(f64::from));
    let length = quaternion.length();
    if length == 0.0 {
        let message = "the rotation is a zero quaternion; the identity is used";
        context.warn("quaternion-zero", pointer(), message);
        return DQuat::IDENTITY;
    }
    if (length - 1.0).abs() > UNIT_TOLERANCE {
        let message = format!("the rotation has length {length:.4}; it is normalised");
        context.warn("quaternion-not-unit", pointer(), message);
    }
    DQuat::from_vec4(quaternion / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, fault, try_context};

    fn placed(body: &str) -> Placed {
        place(&context(body)).unwrap_or_else(|error| panic!("{error}"))
    }

    fn code(body: &str) -> &'static str {
        fault(place(&context(body))).code
    }

    const MESH: &str = r#""meshes":[{"primitives":[]}]"#;

    #[test]
    fn a_deep_chain_composes() {
        const DEPTH: usize = 10_000;
        let nodes: Vec<String> = (0..DEPTH)
            .map(|i| match i + 1 {
                DEPTH => r#"{"mesh":0}"#.to_owned(),
                child => format!(r#"{{"translation":[1,0,0],"children":[{child}]}}"#),
            })
            .collect();
        let placed = placed(&format!(r#"{MESH},"nodes":[{}]"#, nodes.join(",")));
        assert_eq!(placed.instances[0].world.w_axis.x, (DEPTH - 1) as f64);
        assert_eq!(placed.instances[0].name, format!("node {}", DEPTH - 1));
    }

    #[test]
    fn hierarchies_that_are_no_forest_are_refused() {
        assert_eq!(code(r#""nodes":[{"children":[0]}]"#), "node-cycle");
        assert_eq!(
            code(r#""nodes":[{"children":[1]},{"children":[2]},{"children":[0]}]"#),
            "node-cycle"
        );
        let unreached =
            r#""nodes":[{},{"children":[2]},{"children":[1]}],"scenes":[{"nodes":[0]}]"#;
        assert_eq!(code(unreached), "node-cycle");
        assert_eq!(
            code(r#""nodes":[{"children":[2]},{"children":[2]},{}]"#),
            "node-shared"
        );
        assert_eq!(code(r#""nodes":[{"children":[1,1]},{}]"#), "node-shared");
        assert_eq!(
            code(r#""nodes":[{"children":[1]},{}],"scenes":[{"nodes":[0,1]}]"#),
            "node-shared"
        );
        assert_eq!(
            code(r#""nodes":[{}],"scenes":[{"nodes":[0,0]}]"#),
            "node-shared"
        );
        assert_eq!(code(r#""nodes":[{"children":[5]}]"#), "index-out-of-range");
        assert_eq!(
            code(r#""nodes":[{}],"scenes":[{"nodes":[1]}]"#),
            "index-out-of-range"
        );
        assert_eq!(code(r#""scene":0"#), "index-out-of-range");
        assert_eq!(code(r#""nodes":[{"mesh":0}]"#), "index-out-of-range");
    }

    #[test]
    fn the_default_scene_is_chosen() {
        let nodes = r#""nodes":[{"mesh":0,"name":"a"},{"mesh":0,"name":"b"}]"#;
        let names = |rest: &str| -> Vec<String> {
            let placed = placed(&format!("{MESH},{nodes}{rest}"));
            placed.instances.into_iter().map(|i| i.name).collect()
        };
        let scenes = r#","scenes":[{"nodes":[0]},{"nodes":[1]},{}]"#;
        assert_eq!(names(&format!(r#"{scenes},"scene":1"#)), ["b"]);
        assert_eq!(names(&format!(r#"{scenes},"scene":2"#)), [""; 0]);
        assert_eq!(names(scenes), ["a"]);
        assert_eq!(names(""), ["a", "b"]);
    }

    #[test]
    fn instances_come_in_depth_first_order() {
        let body = r#""nodes":[{"mesh":0,"name":"a","children":[3,2]},{"mesh":0,"name":"d"},
            {"mesh":0,"name":"c"},{"mesh":0,"name":"b"}]"#;
        let names: Vec<String> = placed(&format!("{MESH},{body}"))
            .instances
            .into_iter()
            .map(|i| i.name)
            .collect();
        assert_eq!(names, ["a", "b", "c", "d"]);
    }

    #[test]
    fn transforms_compose_in_double_precision() {
        let body = r#""nodes":[{"translation":[1e7,0,0],"children":[1]},
            {"mesh":0,"translation":[0.001,0,0],"rotation":[0,1,0,0],"scale":[-1,2,1e-8]}]"#;
        let world = placed(&format!("{MESH},{body}")).instances[0].world;
        assert_eq!(world.w_axis.x, 1e7 + f64::from(0.001f32));
        assert_eq!(world.x_axis.x, 1.0);
        assert_eq!(world.y_axis.y, 2.0);
        assert_eq!(world.z_axis.z, -f64::from(1e-8f32));
    }

    #[test]
    fn quaternions_are_normalised_with_a_warning() {
        let warned = |rotation: &str| {
            let context = context(&format!(
                r#"{MESH},"nodes":[{{"mesh":0,"rotation":{rotation}}}]"#
            ));
            let world = place(&context).unwrap().instances[0].world;
            let codes: Vec<_> = context.finish().1.iter().map(|w| w.code).collect();
            (world.x_axis.x, codes)
        };
        assert_eq!(warned("[0,2,0,0]"), (-1.0, vec!["quaternion-not-unit"]));
        assert_eq!(warned("[0,0,0,0]"), (1.0, vec!["quaternion-zero"]));
        assert_eq!(warned("[0,1.0000001,0,0]"), (-1.0, vec![]));
    }

    #[test]
    fn transforms_that_are_not_finite_are_refused() {
        let body = |node: &str| format!(r#"{MESH},"nodes":[{node}]"#);
        let beyond = fault(try_context(&body(r#"{"translation":[1e39,0,0]}"#)));
        assert_eq!(beyond.code, "number-range");
        let chain: Vec<String> = (1..=10)
            .map(|child| format!(r#"{{"scale":[1e38,1,1],"children":[{child}]}}"#))
            .chain(["{}".to_owned()])
            .collect();
        assert_eq!(code(&body(&chain.join(","))), "non-finite-transform");
    }

    #[test]
    fn singular_and_sheared_matrices_are_kept() {
        let body = r#""nodes":[{"mesh":0,"matrix":[0,0,0,0, 1,1,0,0, 0,0,1,0, 5,6,7,1]}]"#;
        let world = placed(&format!("{MESH},{body}")).instances[0].world;
        assert_eq!(world.x_axis, DVec4::ZERO);
        assert_eq!(world.y_axis, DVec4::new(1.0, 1.0, 0.0, 0.0));
        assert_eq!(world.w_axis, DVec4::new(5.0, 6.0, 7.0, 1.0));
    }

    #[test]
    fn a_projective_row_is_dropped_with_a_warning() {
        let context = context(&format!(
            r#"{MESH},"nodes":[{{"mesh":0,"matrix":[1,0,0,3, 0,1,0,0, 0,0,1,0, 0,0,0,2]}}]"#
        ));
        assert_eq!(place(&context).unwrap().instances[0].world, DMat4::IDENTITY);
        assert_eq!(context.finish().1[0].code, "node-matrix-projective");
    }

    #[test]
    fn lights_and_cameras_are_placed() {
        let placed = placed(
            r#""extensions":{"KHR_lights_punctual":{"lights":[
                {"type":"directional","intensity":3},{"type":"point","range":-1,"extras":{"a":1}},
                {"type":"spot","spot":{"innerConeAngle":0.9,"outerConeAngle":0.5}}]}},
            "cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":0.1}},
                {"type":"orthographic","orthographic":{"xmag":0,"ymag":1,"zfar":2,"znear":0}}],
            "nodes":[
                {"rotation":[0,1,0,0],"scale":[9,9,9],"extensions":{"KHR_lights_punctual":{"light":0}}},
                {"translation":[1,2,3],"extensions":{"KHR_lights_punctual":{"light":1}}},
                {"scale":[0,0,0],"extensions":{"KHR_lights_punctual":{"light":2}}},
                {"camera":0,"name":"eye"},{"camera":0,"name":"eye"},{"camera":0,"name":"eye (2)"},
                {"camera":0},{"camera":1}]"#,
        );
        assert_eq!(placed.lights[0].direction, DVec3::Z);
        assert_eq!(placed.lights[0].kind, crate::scene::LightKind::Directional);
        assert_eq!(placed.lights[1].position, DVec3::new(1.0, 2.0, 3.0));
        let unbounded = crate::scene::LightKind::Point {
            range: f32::INFINITY,
        };
        assert_eq!(placed.lights[1].kind, unbounded);
        assert_eq!(placed.lights[2].direction, DVec3::NEG_Z);
        let crate::scene::LightKind::Spot { inner, outer, .. } = placed.lights[2].kind else {
            panic!("{:?}", placed.lights[2].kind);
        };
        assert!(inner < outer && outer == 0.5);
        let names: Vec<&str> = placed.cameras.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["eye", "eye (2)", "eye (2) (2)", "camera 0"]);
        assert_eq!(placed.cameras[0].forward, DVec3::NEG_Z);
    }

    #[test]
    fn gpu_instances_are_placed_in_their_node() {
        let zeros = r#""accessors":[{"componentType":5126,"type":"VEC3","count":3}]"#;
        let node = r#"{"mesh":0,"name":"n","translation":[1,2,3],
            "extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0}}}}"#;
        let placed = placed(&format!(r#"{MESH},{zeros},"nodes":[{node},{{"mesh":0}}]"#));
        let names: Vec<&str> = placed.instances.iter().map(|i| i.name.as_str()).collect();
        assert_eq!(names, ["n #0", "n #1", "n #2", "node 1"]);
        assert_eq!(placed.instances[2].world.w_axis.y, 2.0);
        assert_eq!(placed.shapes.len(), 1);
        let many = zeros.replace("3}", "1048577}");
        let body = format!(r#"{MESH},{many},"nodes":[{node}]"#);
        assert_eq!(code(&body), "scene-too-large");
    }

    #[test]
    fn meshes_are_shared_where_their_pose_is() {
        let body = r#""meshes":[{"primitives":[],"weights":[0,0.5]}],"skins":[{"joints":[5]}],
            "nodes":[{"mesh":0},{"mesh":0,"weights":[0,0]},{"mesh":0,"weights":[0,0.5]},
                {"mesh":0,"skin":0,"translation":[9,9,9]},{"mesh":0,"skin":0},{"translation":[7,0,0]}],
            "scenes":[{"nodes":[0,1,2,3,4]}]"#;
        let placed = placed(body);
        let meshes: Vec<u32> = placed.instances.iter().map(|i| i.mesh).collect();
        assert_eq!(meshes, [0, 1, 0, 2, 2]);
        assert_eq!(placed.shapes[0].weights(), [0.0, 0.5]);
        assert!(placed.shapes[1].weights().is_empty());
        assert_eq!(placed.shapes[2].skin, Some(0));
        assert_eq!(placed.instances[3].world, DMat4::IDENTITY);
        // The joint is not in the scene but has a place.
        assert_eq!(placed.worlds[5].w_axis.x, 7.0);
    }

    #[test]
    fn skins_of_meshes_without_joints_are_left_out() {
        let context = context(
            r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"skins":[{"joints":[0]}],
            "nodes":[{"mesh":0,"skin":0,"translation":[1,0,0]}]"#,
        );
        let placed = place(&context).unwrap();
        assert_eq!(placed.shapes[0].skin, None);
        assert_eq!(placed.instances[0].world.w_axis.x, 1.0);
        assert_eq!(context.finish().1[0].code, "skin-attributes");
    }
}
