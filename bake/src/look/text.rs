//! Numbers and names as text.

use std::fmt::Write;

/// Bytes for people: decimal prefixes, four digits at most.
pub fn bytes_text(count: u64) -> String {
    match count {
        0..10_000 => format!("{count} B"),
        10_000..10_000_000 => format!("{:.1} kB", count as f64 / 1e3),
        _ => format!("{:.2} MB", count as f64 / 1e6),
    }
}

/// Three decimals, or an exponent where they would say little.
pub fn number(value: f64) -> String {
    if value == 0.0 || (1e-2..1e6).contains(&value.abs()) {
        format!("{value:.3}")
    } else {
        format!("{value:.2e}")
    }
}

/// A name out of a file, safe to print: control characters, with which a terminal could be steered, are escaped.
pub fn printable(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for character in name.chars() {
        // The second range holds the marks that turn the direction of writing around.
        if character.is_control()
            || matches!(character, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        {
            let _ = write!(text, "{}", character.escape_unicode());
        } else {
            text.push(character);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_steer_a_terminal() {
        assert_eq!(printable("Größe 1"), "Größe 1");
        assert_eq!(
            printable("a\x1b[2Jb\n\u{202e}"),
            "a\\u{1b}[2Jb\\u{a}\\u{202e}"
        );
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [
                bytes_text(9_999),
                bytes_text(10_000),
                bytes_text(12_345_678)
            ],
            ["9999 B", "10.0 kB", "12.35 MB"]
        );
        assert_eq!(
            [number(0.0), number(1.0 / 3.0), number(1e-7)],
            ["0.000", "0.333", "1.00e-7"]
        );
    }
}
