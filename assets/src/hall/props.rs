//! The things that stand and hang in the hall.

use glam::{DVec2, DVec3, Mat4, Quat, Vec3};
use libm::{cos, pow, sin};

use super::palette::Palette;
use super::{BAY, COLUMN_ROW};
use crate::gltf::{Builder, Placement};
use crate::mesh::Mesh;
use crate::noise::{hash01, smoothstep};

const TAU: f64 = std::f64::consts::TAU;
const PEDESTAL_HEIGHT: f32 = 1.0;
const SPHERE_RADIUS: f32 = 0.28;

/// Half of a pair of curtains: hung at y = 0 from x = 0 (the column) to 0.92, tied back to the column.
pub fn curtain() -> Mesh {
    const WIDTH: f64 = 0.92;
    const LENGTH: f64 = 4.55;
    const TIE: f64 = 0.64;
    let mut mesh = Mesh::default();
    mesh.surface(52, 36, DVec2::new(2.6, 10.0), |u, v| {
        let gather = pow(smoothstep(0.0, TIE, v), 1.4);
        let narrow = if v < TIE {
            1.0 - 0.74 * gather
        } else {
            0.26 + 0.22 * smoothstep(TIE, 1.0, v)
        };
        let amplitude = 0.020 + 0.022 * (1.0 - narrow);
        let fold = sin(TAU * 3.5 * u + 0.7 * sin(4.0 * v)) + 0.3 * sin(TAU * 2.1 * u + 1.5 * v);
        // The free edge hangs lower above the tie, as cloth does that is drawn aside.
        let droop = 0.5 * u * gather * (1.0 - smoothstep(TIE, 1.0, v));
        let waist = 1.0 - 0.25 * (1.0 - smoothstep(0.0, 0.16, libm::fabs(v - TIE)));
        DVec3::new(
            WIDTH * u * narrow * waist,
            -LENGTH * v - droop,
            amplitude * fold * waist,
        )
    });
    mesh
}

/// A cloth slung between two columns, hung at y = 0 about x = 0.
pub fn swag() -> Mesh {
    const HALF: f64 = 0.96;
    let mut mesh = Mesh::default();
    mesh.surface(36, 22, DVec2::new(4.0, 2.8), |u, v| {
        let x = 2.0 * u - 1.0;
        let sag = 1.0 - x * x;
        let fold = sin(TAU * 2.6 * v + 0.7 * x) * (0.2 + 0.8 * sag);
        DVec3::new(
            HALF * x * (1.0 - 0.04 * v),
            -(0.10 + 1.15 * v) * sag - 0.22 * v,
            0.05 * fold + 0.12 * sag * sin(3.0 * v),
        )
    });
    mesh
}

/// A carved pair of strands that wind upwards to the right, 1.7 m high; its mirror image winds to the left.
pub fn carving() -> Mesh {
    let mut mesh = Mesh::default();
    for strand in [0.0, 0.5] {
        mesh.surface(24, 60, DVec2::new(1.0, 4.0), |u, v| {
            let t = 1.0 - v;
            let axis = |t: f64| {
                let angle = TAU * (1.35 * t + strand);
                let reach = 0.20 * pow(1.0 - 0.82 * t.min(1.0), 0.8);
                let lean = 0.16 * t * t;
                DVec3::new(
                    reach * cos(angle) + lean,
                    1.7 * t - 0.08,
                    -reach * sin(angle),
                )
            };
            let tangent = (axis(t + 1e-3) - axis(t - 1e-3)).normalize();
            let side = tangent.cross(DVec3::Z).normalize();
            let other = side.cross(tangent);
            let radius = 0.17 * pow(1.0 - 0.94 * t.min(1.0), 0.7) + 0.004;
            let angle = -u * TAU;
            axis(t) + radius * (side * cos(angle) + other * sin(angle))
        });
    }
    mesh
}

/// A round pedestal with mouldings, `PEDESTAL_HEIGHT` high.
pub fn pedestal() -> Mesh {
    let cove: Vec<(f64, f64)> = (0..=6)
        .map(|i| {
            let t = f64::from(i) / 6.0;
            (0.24 - 0.07 * sin(t * TAU / 4.0), 0.93 - 0.10 * t)
        })
        .collect();
    let foot: Vec<(f64, f64)> = (0..=6)
        .map(|i| {
            let t = f64::from(i) / 6.0;
            (0.18 + 0.09 * (1.0 - cos(t * TAU / 4.0)), 0.20 - 0.10 * t)
        })
        .collect();
    let mut mesh = Mesh::default();
    mesh.lathe(
        &[
            &[(0.0, 1.0), (0.24, 1.0)],
            &[(0.24, 1.0), (0.25, 0.99)],
            &[(0.25, 0.99), (0.25, 0.94)],
            &[(0.25, 0.94), (0.24, 0.93)],
            &cove,
            &[(0.17, 0.83), (0.18, 0.20)],
            &foot,
            &[(0.27, 0.10), (0.27, 0.0)],
        ],
        40,
        DVec2::new(2.0, 1.0),
    );
    mesh
}

/// A flared pot 0.5 m high without its earth.
pub fn pot() -> Mesh {
    let mut mesh = Mesh::default();
    let belly: Vec<(f64, f64)> = (0..=8)
        .map(|i| {
            let t = f64::from(i) / 8.0;
            (0.27 - 0.10 * t * t, 0.42 - 0.42 * t)
        })
        .collect();
    mesh.lathe(
        &[
            &[(0.25, 0.40), (0.26, 0.50)],
            &[(0.26, 0.50), (0.31, 0.50)],
            &[(0.31, 0.50), (0.31, 0.42)],
            &[(0.31, 0.42), (0.27, 0.42)],
            &belly,
        ],
        40,
        DVec2::ONE,
    );
    mesh
}

/// Fronds that rise from the origin and arch outwards, each a bent strip of quads.
pub fn fronds() -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..22_i64 {
        let length = 0.80 + 0.40 * hash01(i, 0, 1);
        let steep = 0.30 + 1.0 * (i as f64 / 22.0) + 0.12 * hash01(i, 1, 1);
        let mut strip = Mesh::default();
        strip.surface(2, 6, DVec2::ONE, |u, v| {
            let t = 1.0 - v;
            // The strip leaves at the angle `steep` off the vertical and bends down along its length.
            let bend = steep + 1.0 * t;
            let out = length * t * (0.35 * sin(steep) + 0.65 * sin(0.5 * (steep + bend)));
            let up = length * t * (0.35 * cos(steep) + 0.65 * cos(0.5 * (steep + bend)));
            let s = 2.0 * u - 1.0;
            let half = 0.26 * length;
            DVec3::new(half * s, up + 0.10 * length * s * s * t, out)
        });
        let yaw = (137.508 * i as f64 + 18.0 * hash01(i, 2, 1)).to_radians() as f32;
        mesh.append(&strip, Mat4::from_rotation_y(yaw));
    }
    mesh
}

fn plate(low: [f64; 3], high: [f64; 3]) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.cuboid(DVec3::from_array(low), DVec3::from_array(high), 1.0);
    mesh
}

/// Places everything.
pub fn build(scene: &mut Builder, palette: &Palette) {
    carpet(scene, palette);
    hangings(scene, palette);
    spheres(scene, palette);
    carvings(scene, palette);
    plants(scene, palette);
    panes(scene, palette);
    lamps(scene, palette);
}

fn carpet(scene: &mut Builder, palette: &Palette) {
    // From x = 0, so that the planar UVs span the pattern's width once.
    let runner = plate([0.0, 0.0, -8.8], [1.6, 0.014, 8.8]);
    let mut runner = runner;
    for uv in &mut runner.uvs {
        *uv /= 1.6;
    }
    let runner = scene.geometry(&runner);
    scene.place(
        "carpet",
        runner,
        palette.carpet,
        Placement::at(-0.8, 0.0, 0.0),
    );
}

fn hangings(scene: &mut Builder, palette: &Palette) {
    let curtain = scene.geometry(&curtain());
    let swag = scene.geometry(&swag());
    for (side, x) in [(0_usize, -COLUMN_ROW), (1, COLUMN_ROW)] {
        for bay in 0..6_usize {
            let z = (bay as f32 - 2.5) * BAY;
            let cloth = palette.cloth[(bay + side) % 3];
            if bay % 2 == 0 {
                let at = Placement::at(x, 4.93, z).yaw(90.0);
                scene.place("swag", swag, cloth, at);
            } else {
                let near = Placement::at(x, 4.98, z + 0.96).yaw(90.0);
                scene.place("curtain", curtain, cloth, near);
                let far = Placement::at(x, 4.98, z - 0.96).yaw(90.0);
                let far = far.scaled(-1.0, 1.0, 1.0);
                scene.place("mirrored curtain", curtain, cloth, far);
            }
        }
    }
}

fn spheres(scene: &mut Builder, palette: &Palette) {
    let pedestal = scene.geometry(&pedestal());
    let sphere = scene.geometry(&Mesh::sphere(f64::from(SPHERE_RADIUS), 64, 32));
    let mut dielectrics = palette.dielectrics.iter();
    for (i, &metal) in palette.metals.iter().enumerate() {
        let z = 3.2 - 1.45 * i as f32;
        for x in [-1.7, 1.7] {
            let at = Placement::at(x, 0.0, z);
            scene.place("pedestal", pedestal, palette.marble, at);
        }
        let y = PEDESTAL_HEIGHT + SPHERE_RADIUS;
        scene.place("metal sphere", sphere, metal, Placement::at(-1.7, y, z));
        if i == 2 {
            let y = PEDESTAL_HEIGHT + 1.35 * SPHERE_RADIUS;
            let at = Placement::at(1.7, y, z).yaw(25.0).scaled(0.7, 1.35, 0.9);
            scene.place("ellipsoid", sphere, palette.brushed, at);
        } else if let Some(&glaze) = dielectrics.next() {
            scene.place("glazed sphere", sphere, glaze, Placement::at(1.7, y, z));
        }
    }
}

fn carvings(scene: &mut Builder, palette: &Palette) {
    let carving = scene.geometry(&carving());
    let plinth = scene.geometry(&plate([-0.36, 0.0, -0.36], [0.36, 0.8, 0.36]));
    for (name, side) in [("carving", 1.0), ("mirrored carving", -1.0)] {
        let x = 2.1 * side;
        scene.place(
            "plinth",
            plinth,
            palette.limestone,
            Placement::at(x, 0.0, -8.7),
        );
        let at = Placement::at(x, 0.8, -8.7).scaled(side, 1.0, 1.0);
        scene.place(name, carving, palette.marble, at);
    }
}

fn plants(scene: &mut Builder, palette: &Palette) {
    let mut earth = Mesh::default();
    earth.lathe(&[&[(0.0, 0.46), (0.257, 0.455)]], 24, DVec2::ONE);
    let earth = scene.geometry(&earth);
    let pot = scene.geometry(&pot());
    let fronds = scene.geometry(&fronds());
    for (x, z, yaw) in [(-2.45, 4.9, 0.0), (2.35, -7.3, 70.0), (-2.35, -7.3, 200.0)] {
        let at = Placement::at(x, 0.0, z).yaw(yaw);
        scene.place("pot", pot, palette.terracotta, at);
        scene.place("earth", earth, palette.soil, at);
        let crown = Placement::at(x, 0.46, z).yaw(yaw);
        scene.place("fronds", fronds, palette.leaf, crown);
    }
}

fn panes(scene: &mut Builder, palette: &Palette) {
    let pane = scene.geometry(&Mesh::quad(0.74, 1.70, 1.0));
    let foot = scene.geometry(&plate([-0.42, 0.0, -0.14], [0.42, 0.07, 0.14]));
    let post = scene.geometry(&plate([-0.02, 0.0, -0.02], [0.02, 1.84, 0.02]));
    let spots = [(2.0, 5.75, -16.0), (2.42, 5.1, -8.0), (2.2, 4.35, 6.0)];
    for (&glass, (x, z, yaw)) in palette.glass.iter().zip(spots) {
        let at = |y: f32| Placement::at(x, y, z).yaw(yaw);
        scene.place("glass pane", pane, glass, at(0.95));
        scene.place("pane foot", foot, palette.wood, at(0.0));
        for end in [-0.39_f32, 0.39] {
            let turn = Quat::from_rotation_y(yaw.to_radians());
            let offset = turn * Vec3::new(end, 0.0, 0.0);
            let post_at = Placement::at(x + offset.x, 0.0, z + offset.z).yaw(yaw);
            scene.place("pane post", post, palette.wood, post_at);
        }
    }
}

fn lamps(scene: &mut Builder, palette: &Palette) {
    let bulb = scene.geometry(&Mesh::sphere(0.15, 32, 16));
    let mut frame = plate([-0.008, 0.24, -0.008], [0.008, 1.50, 0.008]);
    let cap: Vec<(f64, f64)> = (0..=6)
        .map(|i| {
            let t = f64::from(i) / 6.0;
            (0.02 + 0.20 * t * t, 0.26 - 0.16 * t)
        })
        .collect();
    frame.lathe(
        &[
            &cap,
            &[(0.22, 0.10), (0.21, 0.09)],
            &[(0.21, 0.09), (0.02, 0.22)],
        ],
        32,
        DVec2::ONE,
    );
    let frame = scene.geometry(&frame);
    for z in [5.0, 0.0, -5.0] {
        let at = Placement::at(0.0, 4.08, z);
        scene.place("lamp", bulb, palette.lamp, at);
        scene.place("lamp frame", frame, palette.bronze, at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume of the cones from the origin to the triangles, which open ends make smaller than the
    /// solid's; negative where they face inwards.
    fn volume(mesh: &Mesh) -> f32 {
        let at = |i: u16| mesh.positions[usize::from(i)];
        mesh.indices
            .chunks(3)
            .map(|t| at(t[0]).cross(at(t[1])).dot(at(t[2])) / 6.0)
            .sum()
    }

    #[test]
    fn solids_face_outwards() {
        let solids = [
            ("carving", carving(), 0.04..0.3),
            ("pedestal", pedestal(), 0.08..0.2),
            ("pot", pot(), 0.03..0.2),
            ("column", super::super::architecture::column(), 0.5..1.0),
        ];
        for (name, mesh, range) in solids {
            let volume = volume(&mesh);
            assert!(range.contains(&volume), "{name}: {volume} cubic metres");
        }
    }
}
