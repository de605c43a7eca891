//! The shadow map: depth of what casts shadows, one layer per cascade.
//!
//! Scenes are static, so a layer is drawn anew only where its cascade moved. Both sides of every surface cast, as they
//! stop a ray: a wall modelled from inside alone keeps the sun out.

use cairn_format::gpu::{DrawGroup, ShadowPush};
use cairn_format::{Aabb, BoundsView};

use super::{Alpha, FAR_DEPTH, SurfacePipelines, depth_state, issue};
use crate::camera::Camera;
use crate::cascade::{Cascade, Cascades, MAX_CASCADES};
use crate::draw::{Draw, DrawList, DrawStats};
use crate::gpu::{
    Buffer, Commands, DepthAttachment, Gpu, GpuResult, GraphicsPipeline, GraphicsPipelineDesc,
    Layouts, Load, Shader, VertexInput, vk,
};
use crate::graph::{Handle, Images};
use crate::lights::Shadowed;
use crate::plan::Plan;
use crate::settings::ShadowSettings;

/// Texels by which the slope bias moves a caster at most.
const MAX_BIAS: f32 = 4.0;

/// The pass's pipelines.
pub struct Shadow(SurfacePipelines);

/// The cascades of a frame, and what they draw. Buffers keep their capacity between frames.
#[derive(Default)]
pub struct ShadowView {
    /// The cascades.
    pub cascades: Cascades,
    slope_bias: f32,
    /// Casters of each layer, where it is drawn anew.
    lists: [DrawList; MAX_CASCADES],
    /// Which layers are drawn anew.
    stale: [bool; MAX_CASCADES],
    /// What the map's layers hold: cascade and slope bias.
    held: [Option<(Cascade, f32)>; MAX_CASCADES],
}

/// The static scene, as culling reads it.
#[derive(Clone, Copy)]
pub struct Casters<'a> {
    /// World bounds of the scene.
    pub scene: Aabb,
    pub groups: &'a [DrawGroup],
    pub bounds: BoundsView<'a>,
    pub clusters: Option<BoundsView<'a>>,
}

impl ShadowView {
    /// Fits the cascades to a view, and culls for those that moved.
    pub fn update(
        &mut self,
        camera: &Camera,
        aspect: f32,
        light: Shadowed,
        casters: &Casters<'_>,
        settings: &ShadowSettings,
    ) {
        let direction = light.direction;
        self.cascades = Cascades::fit(camera, aspect, direction, casters.scene, settings);
        self.slope_bias = settings.slope_bias;
        self.stale = [false; MAX_CASCADES];
        // Where all others are drawn anew, these lose what they hold.
        self.held[self.cascades.count() as usize..].fill(None);
        for (index, cascade) in self.cascades.iter().enumerate() {
            let same = |(held, bias): &(Cascade, f32)| {
                (held.matrix, held.casters, *bias)
                    == (cascade.matrix, cascade.casters, settings.slope_bias)
            };
            if self.held[index].as_ref().is_some_and(same) {
                continue;
            }
            self.stale[index] = true;
            self.held[index] = Some((*cascade, settings.slope_bias));
            self.lists[index].build_casters(
                casters.groups,
                &casters.bounds,
                casters.clusters.as_ref(),
                &cascade.caster_frustum(),
            );
        }
    }

    /// Forgets what the map holds: it is a new one.
    pub fn forget(&mut self) {
        self.held = [None; MAX_CASCADES];
    }

    /// Whether some layer is drawn anew.
    pub fn is_stale(&self) -> bool {
        self.stale.contains(&true)
    }

    /// Whether no layer that a shader may read keeps what it holds.
    pub fn is_all_stale(&self) -> bool {
        self.stale[..self.cascades.count() as usize]
            .iter()
            .all(|stale| *stale)
    }

    /// What is drawn anew.
    pub fn stats(&self) -> DrawStats {
        let mut sum = DrawStats::default();
        for (_, _, list) in self.layers() {
            let stats = list.stats();
            sum.draws += stats.draws;
            sum.visible_instances += stats.visible_instances;
            sum.triangles += stats.triangles;
        }
        sum
    }

    /// Writes the casters' instance indices of all layers one behind the other.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn write(&self, buffer: &mut Buffer) -> GpuResult<()> {
        let mut offset = 0;
        for (_, _, list) in self.layers() {
            buffer.write(offset, &list.visible)?;
            offset += size_of_val(&list.visible[..]) as u64;
        }
        Ok(())
    }

    /// The layers that are drawn anew.
    fn layers(&self) -> impl Iterator<Item = (u32, &Cascade, &DrawList)> {
        let layers = (0..).zip(self.cascades.iter()).zip(&self.lists);
        let stale = layers.filter(|((index, _), _)| self.stale[*index as usize]);
        stale.map(|((index, cascade), list)| (index, cascade, list))
    }
}

impl Shadow {
    /// Builds what the package needs.
    pub fn new(gpu: &Gpu, layouts: &Layouts, plan: &Plan) -> GpuResult<Self> {
        let build = |alpha| pipeline(gpu, layouts, plan, alpha);
        SurfacePipelines::new(plan.variant.masked, build).map(Self)
    }

    /// Clears and draws every layer whose cascade moved. Sets, vertices and indices are bound; binding 1 is left at
    /// the casters.
    pub fn record(
        &self,
        commands: &mut Commands,
        layouts: &Layouts,
        images: &Images<'_>,
        map: Handle,
        view: &ShadowView,
        casters: &Buffer,
    ) {
        let extent = images.get(map).extent();
        let mut offset = 0;
        for (index, cascade, list) in view.layers() {
            let depth = DepthAttachment {
                image: images.layer(map, index),
                load: Load::Clear(FAR_DEPTH),
                store: true,
            };
            commands.begin_rendering(extent, &[], Some(depth));
            commands.push_constants(
                layouts,
                &ShadowPush {
                    cascade_index: index,
                },
            );
            commands.bind_vertex_buffer(1, casters, offset);
            let (opaque, masked) = (&self.0.opaque, self.0.masked());
            self.bucket(commands, opaque, extent, view, cascade, &list.opaque);
            self.bucket(commands, masked, extent, view, cascade, &list.masked);
            commands.end_rendering();
            offset += size_of_val(&list.visible[..]) as u64;
        }
    }

    fn bucket(
        &self,
        commands: &mut Commands,
        pipeline: &GraphicsPipeline,
        extent: [u32; 2],
        view: &ShadowView,
        cascade: &Cascade,
        draws: &[Draw],
    ) {
        if draws.is_empty() {
            return;
        }
        commands.bind_graphics(pipeline);
        commands.set_viewport(extent, false);
        commands.set_scissor(extent);
        commands.set_cull_mode(vk::CullModeFlags::NONE);
        commands.set_front_face(vk::FrontFace::COUNTER_CLOCKWISE);
        // Away from the light is towards zero in reverse-Z.
        let clamp = -MAX_BIAS * cascade.texel / view.cascades.depth_range;
        commands.set_depth_bias(0.0, clamp, -view.slope_bias);
        for draw in draws {
            issue(commands, draw);
        }
    }
}

/// Opaque casters need no fragment shader.
fn pipeline(
    gpu: &Gpu,
    layouts: &Layouts,
    plan: &Plan,
    alpha: Alpha,
) -> GpuResult<GraphicsPipeline> {
    let constants = plan.variant.constants(alpha);
    let shader = |spirv| Shader {
        spirv,
        constants: &constants,
    };
    let desc = GraphicsPipelineDesc {
        name: match alpha {
            Alpha::Cut => "shadow masked",
            _ => "shadow opaque",
        },
        vertex: shader(cairn_shaders::SHADOW_VERT.spirv),
        fragment: (alpha == Alpha::Cut).then(|| shader(cairn_shaders::SHADOW_FRAG.spirv)),
        input: VertexInput::Positions,
        colors: &[],
        depth: Some(depth_state(vk::CompareOp::GREATER, true)),
        samples: 1,
        depth_bias: true,
    };
    GraphicsPipeline::new(gpu, layouts, &desc)
}
