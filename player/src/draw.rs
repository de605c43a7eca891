//! Turns the package's static draw groups into this frame's draws: culled, bucketed, transparent ones sorted.

use cairn_format::gpu::{ALPHA_BLEND, ALPHA_MASK, DRAW_DOUBLE_SIDED, DRAW_MIRRORED, DrawGroup};
use cairn_format::{Aabb, BoundsView, Frustum};
use glam::{Mat4, Vec2, Vec3};

/// Instances from which a range pays for the test of its clusters.
const CLUSTERED: usize = 128;

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
    /// Culls every group against the frustum, in one call where groups adjoin, and sorts what blends by squared
    /// distance from `eye` to the centre of its box.
    pub fn build(
        &mut self,
        groups: &[DrawGroup],
        bounds: &BoundsView,
        clusters: Option<&BoundsView>,
        frustum: &Frustum,
        eye: Vec3,
    ) {
        self.cull(groups, bounds, clusters, frustum, |list, draw| {
            list.push_blend(draw, bounds, eye);
        });
        self.sort_blend();
    }

    /// Culls what casts shadows: every group that does not blend.
    pub fn build_casters(
        &mut self,
        groups: &[DrawGroup],
        bounds: &BoundsView,
        clusters: Option<&BoundsView>,
        frustum: &Frustum,
    ) {
        self.cull(groups, bounds, clusters, frustum, |_, _| {});
    }

    fn cull(
        &mut self,
        groups: &[DrawGroup],
        bounds: &BoundsView,
        clusters: Option<&BoundsView>,
        frustum: &Frustum,
        mut blend: impl FnMut(&mut Self, Draw),
    ) {
        self.opaque.clear();
        self.masked.clear();
        self.blend.clear();
        self.visible.clear();
        self.sorted.clear();
        let adjoin =
            |a: &DrawGroup, b: &DrawGroup| a.first_instance + a.instance_count == b.first_instance;
        for run in groups.chunk_by(adjoin) {
            let (first, last) = (run[0], run[run.len() - 1]);
            let range = first.first_instance..last.first_instance + last.instance_count;
            let mut seen = self.visible.len();
            match clusters.filter(|_| range.len() >= CLUSTERED) {
                Some(clusters) => {
                    frustum.cull_clustered(bounds, clusters, range, &mut self.visible);
                }
                None => frustum.cull(bounds, range, &mut self.visible),
            }
            for group in run {
                let end = group.first_instance + group.instance_count;
                let count = shown_below(&self.visible[seen..], end);
                self.push(group, seen as u32, count as u32, &mut blend);
                seen += count;
            }
        }
    }

    fn push(
        &mut self,
        group: &DrawGroup,
        first_visible: u32,
        instance_count: u32,
        blend: &mut impl FnMut(&mut Self, Draw),
    ) {
        if instance_count == 0 || group.index_count == 0 {
            return;
        }
        let draw = Draw {
            first_index: group.first_index,
            index_count: group.index_count,
            vertex_offset: group.vertex_offset as i32,
            first_visible,
            instance_count,
            double_sided: group.flags & DRAW_DOUBLE_SIDED != 0,
            mirrored: group.flags & DRAW_MIRRORED != 0,
        };
        match group.alpha_mode {
            ALPHA_BLEND => blend(self, draw),
            ALPHA_MASK => self.masked.push(draw),
            _ => self.opaque.push(draw),
        }
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

    /// Pixels that blended instances may cover: left, top, right, bottom of a box around their boxes' corners, a pixel
    /// wider. All of them where a corner lies behind the camera; `None` where there is nothing.
    pub fn blended_part(
        &self,
        bounds: &BoundsView,
        view_projection: &Mat4,
        extent: [u32; 2],
    ) -> Option<[u32; 4]> {
        let size = Vec2::new(extent[0] as f32, extent[1] as f32);
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for draw in &self.blend {
            let instance = self.visible[draw.first_visible as usize];
            let Aabb { min, max } = bounds.get(instance as usize);
            for corner in 0..8 {
                let pick = |bit: usize| {
                    if corner >> bit & 1 == 0 {
                        min[bit]
                    } else {
                        max[bit]
                    }
                };
                let point = Vec3::new(pick(0), pick(1), pick(2)).extend(1.0);
                let clip = *view_projection * point;
                if clip.w <= clip.z.abs() * 1e-6 {
                    return Some([0, 0, extent[0], extent[1]]);
                }
                // Images grow downwards, clip space upwards.
                let ndc = Vec2::new(clip.x, -clip.y) / clip.w;
                let pixel = (ndc * 0.5 + 0.5) * size;
                (low, high) = (low.min(pixel), high.max(pixel));
            }
        }
        let low = (low.floor() - 1.0).clamp(Vec2::ZERO, size);
        let high = (high.ceil() + 1.0).clamp(Vec2::ZERO, size);
        let visible = low.x < high.x && low.y < high.y;
        visible.then(|| [low.x, low.y, high.x, high.y].map(|value| value as u32))
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

/// How many of the ascending `visible` lie below `end`. Groups are mostly small, so it gallops before it bisects.
fn shown_below(visible: &[u32], end: u32) -> usize {
    let mut reach = 1;
    while reach < visible.len() && visible[reach] < end {
        reach *= 2;
    }
    let reach = visible.len().min(reach + 1);
    visible[..reach].partition_point(|instance| *instance < end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_format::bounds::{clusters, to_arrays};

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
        let eye = Vec3::new(0.0, 0.0, 3.0);
        list.build(groups, &view, None, &forward_frustum(), eye);
        let around = clusters(boxes);
        let arrays = to_arrays(&around);
        let clusters = BoundsView::new(&arrays, around.len()).expect("length fits");
        let mut clustered = DrawList::default();
        clustered.build(groups, &view, Some(&clusters), &forward_frustum(), eye);
        assert_eq!(clustered.visible, list.visible);
        assert_eq!(clustered.stats(), list.stats());
        list
    }

    #[test]
    fn large_groups_show_the_same_with_clusters() {
        let boxes: Vec<Aabb> = (0..1000)
            .map(|i| unit_box(Vec3::new(0.0, 0.0, 50.0 - i as f32 * 0.3)))
            .collect();
        let list = build(
            &boxes,
            &[group(0, 3, 0), group(3, 900, 0), group(903, 97, ALPHA_MASK)],
        );
        assert_eq!(list.masked[0].instance_count, 97);
        let count = list.opaque[0].instance_count;
        assert!(count > 500 && count < 900, "{count}");
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
    fn what_blends_casts_no_shadow() {
        let boxes = [-1.0, -5.0, -3.0, 50.0].map(|z| unit_box(Vec3::new(0.0, 0.0, z)));
        let arrays = to_arrays(&boxes);
        let view = BoundsView::new(&arrays, boxes.len()).expect("length fits");
        let groups = [
            group(0, 1, 0),
            group(1, 1, ALPHA_BLEND),
            group(2, 2, ALPHA_MASK),
        ];
        let mut list = DrawList::default();
        list.build_casters(&groups, &view, None, &forward_frustum());
        assert_eq!((list.opaque.len(), list.masked.len()), (1, 1));
        assert!(list.blend.is_empty());
        let shown = |draw: &Draw| list.visible[draw.first_visible as usize];
        assert_eq!((shown(&list.opaque[0]), shown(&list.masked[0])), (0, 2));
        assert_eq!(list.masked[0].instance_count, 1);
    }

    /// Groups that adjoin, overlap nothing and leave gaps, in any order.
    #[test]
    fn every_group_draws_its_own_instances() {
        let boxes: Vec<Aabb> = (0..400)
            .map(|i| unit_box(Vec3::new(0.0, 0.0, if i % 3 == 0 { 50.0 } else { -5.0 })))
            .collect();
        let ranges = [(300, 100), (0, 7), (7, 0), (7, 93), (100, 1), (102, 3)];
        let list = build(&boxes, &ranges.map(|(first, count)| group(first, count, 0)));
        let drawn = ranges
            .iter()
            .filter(|(first, count)| *count > 1 || first % 3 != 0);
        let drawn: Vec<_> = drawn.filter(|(_, count)| *count > 0).collect();
        assert_eq!(list.opaque.len(), drawn.len());
        for (draw, (first, count)) in list.opaque.iter().zip(drawn) {
            let shown =
                &list.visible[draw.first_visible as usize..][..draw.instance_count as usize];
            let expected: Vec<u32> = (*first..first + count).filter(|i| i % 3 != 0).collect();
            assert_eq!(shown, expected);
        }
    }

    #[test]
    fn galloping_counts_what_lies_below() {
        let visible: Vec<u32> = (0..100).map(|i| i * 2).collect();
        for length in 0..100 {
            for end in 0..200 {
                let expected = visible[..length].iter().filter(|i| **i < end).count();
                assert_eq!(shown_below(&visible[..length], end), expected);
            }
        }
    }

    #[test]
    fn nothing_in_nothing_out() {
        let list = build(&[], &[]);
        assert_eq!(list.stats(), DrawStats::default());
    }

    #[test]
    fn the_blended_part_covers_what_blends() {
        let camera = crate::camera::Camera::default();
        let matrix = camera.projection(1.0) * camera.view();
        let part = |center: Vec3| {
            let list = build(&[unit_box(center)], &[group(0, 1, ALPHA_BLEND)]);
            let boxes = to_arrays(&[unit_box(center)]);
            let view = BoundsView::new(&boxes, 1).expect("length fits");
            list.blended_part(&view, &matrix, [100, 100])
        };
        let [left, top, right, bottom] = part(Vec3::ZERO).expect("in sight");
        assert!(left > 0 && top > 0 && right < 100 && bottom < 100);
        assert_eq!((left + right, top + bottom), (100, 100), "in the middle");
        assert_eq!(part(camera.position), Some([0, 0, 100, 100]));
        assert_eq!(part(Vec3::new(0.0, 0.0, 900.0)), None, "behind the camera");
    }
}
