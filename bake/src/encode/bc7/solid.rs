//! Blocks of one colour, which mode 5 stores without loss.

use super::modes::Fields;

/// For each 8-bit value, the 7-bit endpoints whose level at weight 21 of 64 it is.
static ENDS: [[u8; 2]; 256] = ends();

const fn ends() -> [[u8; 2]; 256] {
    let mut ends = [[0; 2]; 256];
    let mut low = 0;
    while low < 128 {
        let mut high = low;
        while high < 128 && high < low + 4 {
            let (first, second) = (low << 1 | low >> 6, high << 1 | high >> 6);
            let level = (43 * first + 21 * second + 32) >> 6;
            ends[level] = [low as u8, high as u8];
            high += 1;
        }
        low += 1;
    }
    ends
}

/// The block whose texels are all `color`.
pub(super) fn solid(color: [u8; 4]) -> [u8; 16] {
    let [red, green, blue] = [0, 1, 2].map(|channel: usize| ENDS[usize::from(color[channel])]);
    let end = |at: usize| [red[at], green[at], blue[at], color[3]];
    Fields {
        mode: 5,
        ends: [[end(0), end(1)], [[0; 4]; 2], [[0; 4]; 2]],
        indices: 0x1111_1111_1111_1111,
        ..Fields::default()
    }
    .pack()
}
