//! How the map's symmetries carry a quadrant of a cube face to the others.
//!
//! Quadrants are the last of their face: `s` and `t` positive, of the face `+X` for sides and `+Y` for poles.

use super::equirect::Equirect;

/// Where a quadrant's image lies in the cube, and where the map's columns and rows go with it.
pub(super) struct Mirror {
    face: usize,
    flip_x: bool,
    flip_y: bool,
    /// Columns run backwards.
    reversed: bool,
    /// Column of column 0.
    origin: i64,
    /// Rows run upwards.
    upside_down: bool,
    width: i64,
    height: usize,
}

impl Mirror {
    /// The quadrant itself.
    pub fn none(input: &Equirect) -> Self {
        Self {
            face: 0,
            flip_x: false,
            flip_y: false,
            reversed: false,
            origin: 0,
            upside_down: false,
            width: i64::from(input.width),
            height: input.height as usize,
        }
    }

    pub fn column(&self, column: i64) -> usize {
        let along = if self.reversed { -column } else { column };
        (self.origin + along).rem_euclid(self.width) as usize
    }

    /// The column that follows in the quadrant.
    pub fn next(&self, column: usize) -> usize {
        let width = self.width as usize;
        match self.reversed {
            false if column + 1 == width => 0,
            false => column + 1,
            true if column == 0 => width - 1,
            true => column - 1,
        }
    }

    pub fn row(&self, row: usize) -> usize {
        if self.upside_down {
            self.height - 1 - row
        } else {
            row
        }
    }

    /// Index in the level of a texel counted from the face's middle.
    pub fn texel(&self, x: usize, y: usize, half: usize) -> usize {
        let place = |at: usize, flip: bool| if flip { half - 1 - at } else { half + at };
        (self.face * 2 * half + place(y, self.flip_y)) * 2 * half + place(x, self.flip_x)
    }
}

/// The sixteen quadrants of the side faces: those of `+X` and their quarter turns.
pub(super) fn sides(input: &Equirect) -> Vec<Mirror> {
    let width = i64::from(input.width);
    let turns = [(0, 0), (4, 1), (1, 2), (5, 3)];
    turns
        .into_iter()
        .flat_map(|(face, quarters)| {
            [(false, false), (true, false), (false, true), (true, true)].map(|(flip_x, flip_y)| {
                // Mirrored in the plane z = 0, longitudes change sign, which columns do about -1/2.
                let origin = if flip_x { width - 1 } else { 0 };
                Mirror {
                    face,
                    flip_x,
                    flip_y,
                    reversed: flip_x,
                    origin: origin + quarters * width / 4,
                    upside_down: flip_y,
                    ..Mirror::none(input)
                }
            })
        })
        .collect()
}

/// The eight quadrants of the poles' faces.
pub(super) fn poles(input: &Equirect) -> Vec<Mirror> {
    let width = i64::from(input.width);
    [(2, false), (3, true)]
        .into_iter()
        .flat_map(|(face, upside_down)| {
            [(false, false), (true, false), (false, true), (true, true)].map(|(flip_x, flip_z)| {
                // x to -x takes longitude to half a turn less itself, z to -z takes it to its negative.
                let origin = match (flip_x, flip_z) {
                    (false, false) => 0,
                    (true, false) => width / 2 - 1,
                    (false, true) => width - 1,
                    (true, true) => width / 2,
                };
                Mirror {
                    face,
                    flip_x,
                    // t is z above and -z below.
                    flip_y: flip_z != upside_down,
                    reversed: flip_x != flip_z,
                    origin,
                    upside_down,
                    ..Mirror::none(input)
                }
            })
        })
        .collect()
}
