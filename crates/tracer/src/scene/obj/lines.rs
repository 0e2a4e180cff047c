//! The lines of an OBJ or MTL file, made safe for tobj.
//!
//! tobj 4.0 panics on a colour of fewer than three numbers and on a face whose
//! index is far from its range, and its errors name no line.

use anyhow::{Context as _, bail, ensure};
use std::borrow::Cow;

/// The file as UTF-8, each statement on one line, single spaces between words. A
/// byte order mark says whether it is in UTF-16.
///
/// A backslash at a line's end continues it; the joined line stands at the
/// first one's place, and empty lines follow, so that numbers stay true.
pub(super) fn joined(bytes: &[u8]) -> String {
    let wide = |of: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes.as_chunks().0.iter().map(|&unit| of(unit)).collect();
        Cow::Owned(String::from_utf16_lossy(&units))
    };
    let text = match bytes {
        [0xfe, 0xff, ..] => wide(u16::from_be_bytes),
        [0xff, 0xfe, ..] => wide(u16::from_le_bytes),
        _ => String::from_utf8_lossy(bytes),
    };
    let mut out = String::with_capacity(text.len());
    let mut owed = 0;
    for line in text.trim_start_matches('\u{feff}').lines() {
        let (body, continues) = match line.trim_end().strip_suffix('\\') {
            Some(body) => (body, true),
            None => (line, false),
        };
        let start = out.len();
        for word in body.split_whitespace() {
            if out.len() > start {
                out.push(' ');
            }
            out.push_str(word);
        }
        out.push(if continues { ' ' } else { '\n' });
        if continues {
            owed += 1;
        } else {
            out.extend(std::iter::repeat_n('\n', std::mem::take(&mut owed)));
        }
    }
    out
}

/// Checks each face's indices.
///
/// # Errors
///
/// Names the line of one that is malformed or out of range.
pub(super) fn check(obj: &str) -> anyhow::Result<()> {
    // Defined so far: positions, texture coordinates, normals.
    let mut counts = [0_i64; 3];
    for (number, line) in (1..).zip(obj.lines()) {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => counts[0] += 1,
            Some("vt") => counts[1] += 1,
            Some("vn") => counts[2] += 1,
            Some("f" | "l") => {
                for word in words {
                    corner(word, counts).with_context(|| format!("line {number}: {word:?}"))?;
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Checks `v`, `v/vt`, `v//vn` or `v/vt/vn`.
fn corner(word: &str, counts: [i64; 3]) -> anyhow::Result<()> {
    let parts: Vec<&str> = word.split('/').collect();
    ensure!(parts.len() <= 3, "a corner has at most three indices");
    ensure!(!parts[0].is_empty(), "a corner needs a vertex");
    for ((part, count), what) in parts.iter().zip(counts).zip(["vertices", "vt", "vn"]) {
        if part.is_empty() {
            continue;
        }
        let index: i64 = part.parse().context("not an index")?;
        // A negative index counts back from the last; none is zero.
        let valid = if index < 0 { index >= -count } else { (1..=count).contains(&index) };
        ensure!(valid, "there are {count} {what} so far, and none is number {index}");
    }
    Ok(())
}

/// Checks an MTL's numbers, and writes grey colours of one number as three.
///
/// # Errors
///
/// Names the line of a colour that is not of one or three numbers.
pub(super) fn checked_mtl(mtl: &str) -> anyhow::Result<String> {
    let mut out = String::with_capacity(mtl.len());
    for (number, line) in (1..).zip(mtl.lines()) {
        let mut words = line.split_whitespace();
        match words.next() {
            Some(key @ ("Ka" | "Kd" | "Ks" | "Ke" | "Tf")) => {
                let values: Vec<f32> = words.map_while(|w| w.parse().ok()).collect();
                let [r, g, b] = match values[..] {
                    [grey] => [grey; 3],
                    [r, g, b, ..] => [r, g, b],
                    _ => bail!("line {number}: {key} needs one or three numbers"),
                };
                let valid = [r, g, b].iter().all(|c| c.is_finite() && *c >= 0.0);
                ensure!(valid, "line {number}: {key} must be finite and at least 0");
                out.push_str(&format!("{key} {r} {g} {b}"));
            }
            _ => out.push_str(line),
        }
        out.push('\n');
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn continued_lines_are_one_and_numbers_stay_true() {
        let text = joined(b"\xef\xbb\xbff 1 \\\r\n  2\\\n\t3\nv 0\t0  0\n");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines.iter().map(|l| l.trim()).collect::<Vec<_>>(),
            ["f 1 2 3", "", "", "v 0 0 0"]
        );
    }

    #[test]
    fn a_byte_order_mark_says_how_characters_are_written() {
        let text = "\u{feff}v 1 2 3\n# é\n";
        let wide = |of: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(of).collect::<Vec<u8>>();
        for bytes in [text.into(), wide(u16::to_be_bytes), wide(u16::to_le_bytes)] {
            assert_eq!(joined(&bytes), "v 1 2 3\n# é\n");
        }
    }

    #[test]
    fn bad_corners_are_named_with_their_line() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
        for (face, expected) in [
            ("f 1 2 4", "line 5: \"4\": there are 3 vertices so far, and none is number 4"),
            ("f 1 2 0", "none is number 0"),
            ("f -4 -2 -1", "none is number -4"),
            ("f 1/2 2/1 3/1", "line 5: \"1/2\": there are 1 vt so far"),
            ("f 1//1 2//1 3//1", "there are 0 vn so far"),
            ("f 1/1/1/1 2 3", "at most three"),
            ("f //1 2 3", "needs a vertex"),
            ("f a b c", "line 5: \"a\": not an index"),
            ("f 99999999999999999999 1 2", "not an index"),
            ("f -9223372036854775808 1 2", "none is number"),
        ] {
            let text = format!("{:#}", check(&format!("{vertices}{face}")).expect_err("bad"));
            assert!(text.contains(expected), "{text}");
        }
        assert!(check(&format!("{vertices}f -3/-1 2/1 3/1")).is_ok(), "all in range");
    }

    #[test]
    fn colours_are_one_number_or_three() {
        assert_eq!(checked_mtl("Kd 0.5\nNs 3").expect("grey"), "Kd 0.5 0.5 0.5\nNs 3\n");
        for (mtl, expected) in [
            ("newmtl a\nKd 1 2", "line 2: Kd needs one or three numbers"),
            ("Ks spectral blue.rfl", "line 1: Ks needs"),
            ("Ke 1 -1 1", "line 1: Ke must be finite and at least 0"),
            ("Kd nan", "line 1: Kd must be finite"),
        ] {
            assert_eq!(checked_mtl(mtl).expect_err("bad").to_string().find(expected), Some(0));
        }
    }
}
