//! The hall's floor, walls, columns and roof.

use glam::{DVec2, DVec3, Mat4};
use libm::{cos, fabs, sin};

use super::palette::Palette;
use super::{BAY, COLUMN_ROW};
use crate::gltf::{Builder, Placement};
use crate::mesh::Mesh;
use crate::noise::smoothstep;

/// An arched opening in a wall panel, metres.
#[derive(Debug, Clone, Copy)]
pub struct Opening {
    pub half_width: f64,
    /// Height of the lower edge; 0 is a doorway.
    pub sill: f64,
    /// Height at which the half-circle begins.
    pub spring: f64,
}

const ARC_SEGMENTS: usize = 16;
const WALL_REPEATS: f64 = 0.8;
const WALL_THICKNESS: f64 = 0.4;

/// A wall panel about x = 0 that stands on y = 0, its faces at z = +-`WALL_THICKNESS`/2.
pub fn wall_panel(width: f64, height: f64, opening: Opening) -> Mesh {
    let mut side = Mesh::default();
    panel_face(&mut side, width, height, opening);
    let mut panel = Mesh::default();
    let out = glam::Vec3::new(0.0, 0.0, WALL_THICKNESS as f32 / 2.0);
    panel.append(&side, Mat4::from_translation(out));
    let back = Mat4::from_translation(-out)
        * Mat4::from_cols_array_2d(&[
            [-1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, -1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]);
    panel.append(&side, back);
    reveal(&mut panel, opening);
    let (w, t) = (width / 2.0, WALL_THICKNESS / 2.0);
    let p = |x: f64, z: f64| DVec3::new(x, height, z);
    panel.flat_quad([p(-w, t), p(w, t), p(w, -t), p(-w, -t)], WALL_REPEATS);
    panel
}

fn arc_point(opening: Opening, step: usize) -> DVec2 {
    let angle = std::f64::consts::PI * (1.0 - step as f64 / ARC_SEGMENTS as f64);
    // The ends are exact so that no crack opens along the jambs.
    let (x, y) = match step {
        0 => (-1.0, 0.0),
        ARC_SEGMENTS => (1.0, 0.0),
        _ => (cos(angle), sin(angle)),
    };
    DVec2::new(
        x * opening.half_width,
        opening.spring + y * opening.half_width,
    )
}

/// The front of a panel at z = 0, split so that every corner of the opening is a corner of its neighbours.
fn panel_face(mesh: &mut Mesh, width: f64, height: f64, opening: Opening) {
    let (w, a) = (width / 2.0, opening.half_width);
    let mut rect = |x0: f64, x1: f64, y0: f64, y1: f64| {
        let p = |x, y| DVec3::new(x, y, 0.0);
        if y1 > y0 {
            mesh.flat_quad([p(x0, y0), p(x1, y0), p(x1, y1), p(x0, y1)], WALL_REPEATS);
        }
    };
    for (y0, y1) in [
        (0.0, opening.sill),
        (opening.sill, opening.spring),
        (opening.spring, height),
    ] {
        rect(-w, -a, y0, y1);
        rect(a, w, y0, y1);
    }
    rect(-a, a, 0.0, opening.sill);
    for i in 0..ARC_SEGMENTS {
        let (l, r) = (arc_point(opening, i), arc_point(opening, i + 1));
        let p = |x, y| DVec3::new(x, y, 0.0);
        mesh.flat_quad(
            [p(l.x, l.y), p(r.x, r.y), p(r.x, height), p(l.x, height)],
            WALL_REPEATS,
        );
    }
}

/// The inner faces of the opening.
fn reveal(mesh: &mut Mesh, opening: Opening) {
    let (a, t) = (opening.half_width, WALL_THICKNESS / 2.0);
    let (low, high) = (opening.sill, opening.spring);
    let p = DVec3::new;
    mesh.flat_quad(
        [
            p(-a, low, t),
            p(-a, low, -t),
            p(-a, high, -t),
            p(-a, high, t),
        ],
        WALL_REPEATS,
    );
    mesh.flat_quad(
        [p(a, low, -t), p(a, low, t), p(a, high, t), p(a, high, -t)],
        WALL_REPEATS,
    );
    if low > 0.0 {
        mesh.flat_quad(
            [p(-a, low, t), p(a, low, t), p(a, low, -t), p(-a, low, -t)],
            WALL_REPEATS,
        );
    }
    let length = std::f64::consts::PI * a;
    let size = DVec2::new(WALL_THICKNESS, length) * WALL_REPEATS;
    mesh.surface(1, ARC_SEGMENTS, size, |u, v| {
        let angle = std::f64::consts::PI * v;
        let exact = |c: f64| if fabs(c) < 1e-12 { 0.0 } else { c };
        p(
            a * cos(angle),
            high + a * exact(sin(angle)),
            t - u * WALL_THICKNESS,
        )
    });
}

const SHAFT: (f64, f64) = (0.46, 4.52);
const FLUTES: f64 = 16.0;

/// A fluted column 5 m high on y = 0.
pub fn column() -> Mesh {
    let mut mesh = Mesh::default();
    let c = DVec3::new;
    mesh.cuboid(c(-0.37, 0.0, -0.37), c(0.37, 0.18, 0.37), 1.0);
    mesh.cuboid(c(-0.36, 4.86, -0.36), c(0.36, 5.0, 0.36), 1.0);
    let half_round = |radius: f64, bulge: f64, top: f64, bottom: f64| -> Vec<(f64, f64)> {
        (0..=6)
            .map(|i| {
                let angle = std::f64::consts::PI * (f64::from(i) / 6.0 - 0.5);
                let y = 0.5 * (top + bottom) - 0.5 * (top - bottom) * sin(angle);
                (radius + bulge * cos(angle), y)
            })
            .collect()
    };
    let torus = half_round(0.30, 0.07, 0.36, 0.18);
    let ring = half_round(0.285, 0.03, 0.46, 0.38);
    let collar = half_round(0.25, 0.025, 4.58, 4.52);
    let echinus: Vec<(f64, f64)> = (0..=8)
        .map(|i| {
            let t = f64::from(i) / 8.0;
            (0.35 - 0.10 * t * t, 4.86 - 0.28 * t)
        })
        .collect();
    let size = DVec2::new(2.0, 1.0);
    mesh.lathe(&[&echinus, &collar], 32, size);
    mesh.lathe(&[&ring, &[(0.285, 0.38), (0.30, 0.36)], &torus], 32, size);
    let (low, high) = SHAFT;
    mesh.surface(96, 10, DVec2::new(2.0, 4.0), |u, v| {
        let angle = -u * std::f64::consts::TAU;
        let ends = smoothstep(0.0, 0.1, v) * smoothstep(0.0, 0.1, 1.0 - v);
        let flute = fabs(sin(u * FLUTES * std::f64::consts::PI));
        let swell = 0.012 * sin(v * std::f64::consts::PI);
        let r = 0.243 + 0.045 * v + swell - 0.022 * ends * flute;
        c(r * cos(angle), high + (low - high) * v, r * sin(angle))
    });
    mesh
}

fn block(low: [f64; 3], high: [f64; 3], repeats: f64) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.cuboid(DVec3::from_array(low), DVec3::from_array(high), repeats);
    mesh
}

fn architrave() -> Mesh {
    let mut mesh = block([-0.3, 5.0, -10.0], [0.3, 5.42, 10.0], 1.0);
    let c = DVec3::new;
    mesh.cuboid(c(-0.38, 5.42, -10.0), c(0.38, 5.6, 10.0), 1.0);
    mesh
}

fn rafters() -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..15 {
        let z = -8.75 + 1.25 * f64::from(i);
        let c = DVec3::new;
        mesh.cuboid(c(-1.15, 5.42, z - 0.08), c(1.1, 5.6, z + 0.08), 1.0);
    }
    mesh
}

/// Places the building.
pub fn build(scene: &mut Builder, palette: &Palette) {
    // 1.6 m a repeat; one box whose top is the floor.
    let floor = block([-8.0, -0.4, -13.6], [8.0, 0.0, 13.6], 0.625);
    let floor = scene.geometry(&floor);
    scene.place("floor", floor, palette.floor, Placement::at(0.0, 0.0, 0.0));
    walls(scene, palette);
    let column = scene.geometry(&column());
    for side in [-1.0_f32, 1.0] {
        for i in -3_i16..=3 {
            let at = Placement::at(side * COLUMN_ROW, 0.0, BAY * f32::from(i));
            scene.place("column", column, palette.limestone, at);
        }
    }
    roof(scene, palette);
}

fn walls(scene: &mut Builder, palette: &Palette) {
    let window = Opening {
        half_width: 0.65,
        sill: 0.9,
        spring: 3.5,
    };
    let door = Opening {
        half_width: 1.4,
        sill: 0.0,
        spring: 2.9,
    };
    let bay = scene.geometry(&wall_panel(f64::from(BAY), 5.6, window));
    for (x, yaw) in [(-6.05, 90.0), (6.05, -90.0)] {
        for i in 0..8_u8 {
            let z = -8.75 + BAY * f32::from(i);
            let at = Placement::at(x, 0.0, z).yaw(yaw);
            scene.place("wall bay", bay, palette.wall, at);
        }
    }
    let gate = scene.geometry(&wall_panel(5.0, 5.85, door));
    let flank = scene.geometry(&wall_panel(3.75, 5.85, window));
    for (z, yaw) in [(-10.2, 0.0), (10.2, 180.0)] {
        let at = Placement::at(0.0, 0.0, z).yaw(yaw);
        scene.place("gate", gate, palette.wall, at);
        for x in [-4.375, 4.375] {
            let at = Placement::at(x, 0.0, z).yaw(yaw);
            scene.place("end wall", flank, palette.wall, at);
        }
    }
}

fn roof(scene: &mut Builder, palette: &Palette) {
    let beam = scene.geometry(&architrave());
    let slab = scene.geometry(&block([-1.68, 5.6, -10.0], [1.68, 5.85, 10.0], 1.0));
    let rafters = scene.geometry(&rafters());
    let tie = scene.geometry(&block([-3.1, 5.56, -0.13], [3.1, 5.84, 0.13], 1.0));
    for side in [-1.0_f32, 1.0] {
        let at = |x: f32| Placement::at(side * x, 0.0, 0.0);
        scene.place("architrave", beam, palette.limestone, at(COLUMN_ROW));
        scene.place("roof slab", slab, palette.limestone, at(4.64));
        scene.place("rafters", rafters, palette.wood, at(4.8));
    }
    for z in [-5.0, 0.0, 5.0] {
        scene.place("tie beam", tie, palette.wood, Placement::at(0.0, 0.0, z));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn a_wall_panel_has_no_cracks() {
        let opening = Opening {
            half_width: 0.65,
            sill: 0.9,
            spring: 3.5,
        };
        let mesh = wall_panel(2.5, 5.6, opening);
        let mut edges: BTreeMap<[[i64; 3]; 2], i64> = BTreeMap::new();
        let key = |i: u16| {
            mesh.positions[usize::from(i)]
                .to_array()
                .map(|c| libm::round(f64::from(c) * 1e5) as i64)
        };
        for t in mesh.indices.chunks(3) {
            for k in 0..3 {
                let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
                *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        for (edge, balance) in edges {
            let outer = |p: [i64; 3]| p[0].abs() == 125_000 || p[1] == 0 || p[1] == 560_000;
            assert!(
                balance == 0 || (outer(edge[0]) && outer(edge[1])),
                "open edge {edge:?}"
            );
        }
    }
}
