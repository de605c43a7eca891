//! Turns the package's static draw groups into this frame's draws: culled, bucketed, transparent ones sorted.

use cairn_format::gpu::{ALPHA_BLEND, ALPHA_MASK, DRAW_DOUBLE_SIDED, DRAW_MIRRORED, DrawGroup};
use cairn_format::{BoundsView, Frustum};
use glam::Vec3;

/// One `vkCmdDrawIndexed`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    pub first_index: u32,
    pub index_count: u32,
    pub vertex_offset: i32,
    /// First entry of [`DrawList::visible`].
    pub first_visible: u32,
    pub instance_count: u32,
    pub double_sided: bool,
    pub mirrored: bool,
}

/// The draws of one view. Buffers keep their capacity between frames.
#[derive(Debug, Default)]
pub struct DrawList {
    pub opaque: Vec<Draw>,
    pub masked: Vec<Draw>,
    /// One instance each, back to front.
    pub blend: Vec<Draw>,
    /// Instance indices, contiguous per draw.
    pub visible: Vec<u32>,
    sorted: Vec<(f32, Draw)>,
}

/// What a view showed and hid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct DrawStats {
    pub draws: u32,
    pub visible_instances: u32,
    pub triangles: u64,
}

impl DrawList {
    /// Culls every group against the frustum and sorts what blends by squared distance from `eye` to the
    /// centre of its box.
    pub fn build(
        &mut self,
        groups: &[DrawGroup],
        bounds: &BoundsView,
        frustum: &Frustum,
        eye: Vec3,
    ) {
        self.opaque.clear();
        self.masked.clear();
        self.blend.clear();
        self.visible.clear();
        self.sorted.clear();
        for group in groups {
            let first_visible = self.visible.len() as u32;
            let range = group.first_instance..group.first_instance + group.instance_count;
            frustum.cull(bounds, range, &mut self.visible);
            let count = self.visible.len() as u32 - first_visible;
            if count == 0 || group.index_count == 0 {
                continue;
            }
            let draw = Draw {
                first_index: group.first_index,
                index_count: group.index_count,
                vertex_offset: group.vertex_offset as i32,
                first_visible,
                instance_count: count,
                double_sided: group.flags & DRAW_DOUBLE_SIDED != 0,
                mirrored: group.flags & DRAW_MIRRORED != 0,
            };
            match group.alpha_mode {
                ALPHA_BLEND => self.push_blend(draw, bounds, eye),
                ALPHA_MASK => self.masked.push(draw),
                _ => self.opaque.push(draw),
            }
        }
        self.sort_blend();
    }

    fn push_blend(&mut self, draw: Draw, bounds: &BoundsView, eye: Vec3) {
        for offset in 0..draw.instance_count {
            let instance = self.visible[(draw.first_visible + offset) as usize];
            let distance = bounds.get(instance as usize).center().distance_squared(eye);
            let single = Draw {
                first_visible: draw.first_visible + offset,
                instance_count: 1,
                ..draw
            };
            self.sorted.push((distance, single));
        }
    }

    /// Ties keep the package's order: `first_visible` ascends with it.
    fn sort_blend(&mut self) {
        self.sorted.sort_unstable_by(|(a, first), (b, second)| {
            b.total_cmp(a)
                .then(first.first_visible.cmp(&second.first_visible))
        });
        self.blend.extend(self.sorted.iter().map(|(_, draw)| *draw));
    }

    /// Sums over all buckets.
    pub fn stats(&self) -> DrawStats {
        let buckets = [&self.opaque, &self.masked, &self.blend];
        let mut stats = DrawStats::default();
        for draw in buckets.into_iter().flatten() {
            stats.draws += 1;
            stats.visible_instances += draw.instance_count;
            stats.triangles += u64::from(draw.index_count / 3) * u64::from(draw.instance_count);
        }
        stats
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_format::Aabb;
    use cairn_format::bounds::to_arrays;

    fn unit_box(center: Vec3) -> Aabb {
        Aabb {
            min: center - 0.5,
            max: center + 0.5,
        }
    }

    fn group(first_instance: u32, instance_count: u32, alpha_mode: u32) -> DrawGroup {
        DrawGroup {
            first_index: 0,
            index_count: 6,
            vertex_offset: 0,
            first_instance,
            instance_count,
            primitive: 0,
            alpha_mode,
            flags: 0,
        }
    }

    fn forward_frustum() -> Frustum {
        let camera = crate::camera::Camera::default();
        Frustum::from_view_projection(&(camera.projection(1.0) * camera.view()))
    }

    fn build(boxes: &[Aabb], groups: &[DrawGroup]) -> DrawList {
        let arrays = to_arrays(boxes);
        let view = BoundsView::new(&arrays, boxes.len()).expect("length fits");
        let mut list = DrawList::default();
        list.build(groups, &view, &forward_frustum(), Vec3::new(0.0, 0.0, 3.0));
        list
    }

    #[test]
    fn hidden_instances_are_left_out() {
        let boxes = [Vec3::ZERO, Vec3::new(0.0, 0.0, 50.0), Vec3::NEG_Z].map(unit_box);
        let list = build(&boxes, &[group(0, 3, 0)]);
        assert_eq!(list.visible, [0, 2]);
        assert_eq!(list.opaque[0].instance_count, 2);
        assert_eq!(list.stats().triangles, 4);
    }

    #[test]
    fn blended_instances_are_drawn_back_to_front() {
        let boxes = [-1.0, -5.0, -3.0].map(|z| unit_box(Vec3::new(0.0, 0.0, z)));
        let list = build(
            &boxes,
            &[group(0, 2, ALPHA_BLEND), group(2, 1, ALPHA_BLEND)],
        );
        let order: Vec<u32> = list
            .blend
            .iter()
            .map(|draw| list.visible[draw.first_visible as usize])
            .collect();
        assert_eq!(order, [1, 2, 0]);
    }

    #[test]
    fn nothing_in_nothing_out() {
        let list = build(&[], &[]);
        assert_eq!(list.stats(), DrawStats::default());
    }
}
