//! Turns triangle strips and fans into triangle lists (glTF 2.0 section 3.7.2.1).

/// How a sequence of vertices forms triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Topology {
    List,
    Strip,
    Fan,
}

impl Topology {
    /// Whether `count` vertices form whole triangles.
    pub fn accepts(self, count: usize) -> bool {
        self != Self::List || count.is_multiple_of(3)
    }

    /// The corners of the triangles of `vertices`, with the winding of the specification.
    pub fn triangles(self, vertices: Vec<u32>) -> Vec<u32> {
        let triangles = vertices.len().saturating_sub(2);
        match self {
            Self::List => vertices,
            Self::Strip => (0..triangles)
                .flat_map(|i| [i, i + (1 + i % 2), i + (2 - i % 2)])
                .map(|corner| vertices[corner])
                .collect(),
            Self::Fan => (0..triangles)
                .flat_map(|i| [i + 1, i + 2, 0])
                .map(|corner| vertices[corner])
                .collect(),
        }
    }
}

/// Number of triangles that name a vertex twice.
pub(super) fn degenerate(triangles: &[u32]) -> usize {
    let repeats = |&[a, b, c]: &[u32; 3]| a == b || b == c || c == a;
    let (triangles, _) = triangles.as_chunks::<3>();
    triangles.iter().filter(|t| repeats(t)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_alternate_their_winding() {
        let strip = Topology::Strip.triangles(vec![7, 3, 9, 1, 4]);
        assert_eq!(strip, [7, 3, 9, 3, 1, 9, 9, 1, 4]);
    }

    #[test]
    fn a_planar_strip_and_fan_face_one_way() {
        let zigzag = [
            [0.0, 0.0],
            [1.0, 0.0],
            [0.0, 1.0],
            [1.0, 1.0],
            [0.0, 2.0f64],
        ];
        let around = [
            [0.0, 0.0],
            [1.0, 0.0],
            [1.0, 1.0],
            [0.0, 1.0],
            [-1.0, 0.5f64],
        ];
        for (topology, points) in [(Topology::Strip, zigzag), (Topology::Fan, around)] {
            let triangles = topology.triangles((0..5).collect());
            assert_eq!(triangles.len(), 9);
            for t in triangles.chunks(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|index| points[index as usize]);
                let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                assert!(area > 0.0, "{topology:?} {t:?}");
            }
        }
    }

    #[test]
    fn fans_share_their_first_vertex() {
        let fan = Topology::Fan.triangles(vec![5, 6, 7, 8]);
        assert_eq!(fan, [6, 7, 5, 7, 8, 5]);
    }

    #[test]
    fn short_sequences_have_no_triangles() {
        for count in 0..3 {
            assert!(Topology::Strip.triangles(vec![0; count]).is_empty());
            assert!(Topology::Fan.triangles(vec![0; count]).is_empty());
        }
        assert!(!Topology::List.accepts(4) && Topology::List.accepts(6));
        assert!(Topology::Strip.accepts(4) && Topology::Fan.accepts(5));
    }

    #[test]
    fn stitches_are_counted() {
        let stitched = Topology::Strip.triangles(vec![0, 1, 2, 2, 3, 3, 4, 5]);
        assert_eq!(degenerate(&stitched), 4);
        assert_eq!(degenerate(&[0, 1, 2, 0, 1, 0]), 1);
    }
}
