//! Every culling kernel against f64 truth and against each other.

mod oracle;

use cairn_format::bounds::{CLUSTER, Kernel, clusters, to_arrays};
use cairn_format::{Aabb, BoundsView, Frustum};
use glam::Vec3;
use oracle::{Random, View, random_box};

const BOXES: usize = 1000;

fn kernels() -> impl Iterator<Item = Kernel> {
    Kernel::ALL
        .into_iter()
        .filter(|kernel| kernel.is_available())
}

/// The visible sets of the whole range by every kernel, flat and clustered, which must be one set.
fn visible_set(frustum: &Frustum, boxes: &[Aabb], range: std::ops::Range<u32>) -> Vec<u32> {
    let arrays = to_arrays(boxes);
    let view = BoundsView::new(&arrays, boxes.len()).expect("length fits");
    let around = clusters(boxes);
    let cluster_arrays = to_arrays(&around);
    let cluster_view = BoundsView::new(&cluster_arrays, around.len()).expect("length fits");
    let sees = |index: &u32| frustum.may_see(&boxes[*index as usize]);
    let expected: Vec<u32> = range.clone().filter(sees).collect();
    let mut visible = Vec::new();
    for kernel in kernels() {
        visible.clear();
        frustum.cull_on(kernel, &view, range.clone(), &mut visible);
        assert_eq!(visible, expected, "{kernel:?} {range:?}");
        visible.clear();
        frustum.cull_clustered_on(kernel, &view, &cluster_view, range.clone(), &mut visible);
        assert_eq!(visible, expected, "{kernel:?} {range:?} clustered");
    }
    visible.clear();
    frustum.cull(&view, range.clone(), &mut visible);
    assert_eq!(visible, expected, "the default kernel, {range:?}");
    expected
}

/// Boxes of which neighbours lie close, so that clusters are inside, outside and between.
fn sorted(mut boxes: Vec<Aabb>) -> Vec<Aabb> {
    boxes.sort_by(|a, b| a.min.x.total_cmp(&b.min.x));
    for slab in boxes.chunks_mut(CLUSTER * 4) {
        slab.sort_by(|a, b| a.min.y.total_cmp(&b.min.y));
    }
    boxes
}

fn random_range(random: &mut Random) -> std::ops::Range<u32> {
    let (a, b) = (
        random.below(BOXES as u64 + 1),
        random.below(BOXES as u64 + 1),
    );
    a.min(b) as u32..a.max(b) as u32
}

#[test]
fn no_box_that_touches_is_culled_and_all_kernels_agree() {
    let mut random = Random(1);
    let (mut kept, mut touching) = (0, 0);
    for _ in 0..300 {
        let view = View::random(&mut random);
        let frustum = Frustum::from_view_projection(&view.matrix);
        let boxes: Vec<Aabb> = (0..BOXES).map(|_| random_box(&mut random, &view)).collect();
        let boxes = sorted(boxes);
        let visible = visible_set(&frustum, &boxes, 0..BOXES as u32);
        visible_set(&frustum, &boxes, random_range(&mut random));
        for (index, aabb) in boxes.iter().enumerate() {
            let passes = view.passes_planes(aabb);
            let found = visible.binary_search(&(index as u32)).is_ok();
            assert!(found || !passes, "{aabb:?} {:?}", view.matrix);
            touching += usize::from(view.touches(aabb));
        }
        kept += visible.len();
    }
    println!("{kept} kept, {touching} touch");
    assert!(touching > 50_000 && kept < 280_000);
}

/// A scene in which clusters of all three kinds occur, culled by ranges that split them.
#[test]
fn clusters_change_nothing() {
    let mut random = Random(2);
    let mut partial = 0;
    for _ in 0..100 {
        let view = View::random(&mut random);
        let frustum = Frustum::from_view_projection(&view.matrix);
        let boxes = (0..BOXES).map(|_| {
            let center = random.vector(-60.0, 60.0).as_vec3();
            Aabb {
                min: center,
                max: center + Vec3::ONE,
            }
        });
        let boxes = sorted(boxes.collect());
        for _ in 0..10 {
            let range = random_range(&mut random);
            let (length, visible) = (range.len(), visible_set(&frustum, &boxes, range));
            partial += usize::from(!visible.is_empty() && visible.len() < length);
        }
    }
    assert!(partial > 200, "{partial}");
}

#[test]
fn broken_boxes_are_kept_by_every_kernel() {
    let mut random = Random(3);
    let values = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        0.0,
        -0.0,
        1e-45,
        1e38,
        -1e38,
        1.0,
        -1.0,
    ];
    for _ in 0..200 {
        let view = View::random(&mut random);
        let frustum = Frustum::from_view_projection(&view.matrix);
        let mut value = || values[random.below(values.len() as u64) as usize];
        let mut corner = || Vec3::new(value(), value(), value());
        let boxes: Vec<Aabb> = (0..BOXES)
            .map(|_| Aabb {
                min: corner(),
                max: corner(),
            })
            .collect();
        let visible = visible_set(&frustum, &boxes, 0..BOXES as u32);
        for (index, aabb) in boxes.iter().enumerate() {
            let finite = aabb.min.is_finite() && aabb.max.is_finite();
            assert!(finite || visible.binary_search(&(index as u32)).is_ok());
        }
    }
}

#[test]
fn ranges_of_every_alignment_agree() {
    let mut random = Random(4);
    let view = View::new(&oracle::infinite_reverse_z(1.0, 1.0, 0.1));
    let frustum = Frustum::from_view_projection(&view.matrix);
    let boxes: Vec<Aabb> = (0..200).map(|_| random_box(&mut random, &view)).collect();
    for start in 0..=200 {
        for end in start..=200 {
            if (end - start) % 7 == 0 || end == 200 {
                visible_set(&frustum, &boxes, start..end);
            }
        }
    }
}

#[test]
fn a_list_with_capacity_is_not_reallocated() {
    let boxes = vec![
        Aabb {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE
        };
        BOXES
    ];
    let arrays = to_arrays(&boxes);
    let view = BoundsView::new(&arrays, BOXES).expect("length fits");
    let frustum = Frustum::from_view_projection(&glam::Mat4::IDENTITY);
    for kernel in kernels() {
        let mut visible = Vec::with_capacity(BOXES + 64);
        let before = (visible.as_ptr(), visible.capacity());
        frustum.cull_on(kernel, &view, 0..BOXES as u32, &mut visible);
        assert_eq!(visible.len(), BOXES);
        assert_eq!(before, (visible.as_ptr(), visible.capacity()));
    }
}
