//! MessagePack, written only: what Groot2 reads blackboards in.

use crate::literal::Literal;

/// A list of more values, or a longer text, is shown as a summary; nobody reads a point cloud in a monitor.
const MAX_ITEMS: usize = 10_000;
const MAX_TEXT_BYTES: usize = 64 * 1024;
/// Deeper values are shown as a summary.
const MAX_DEPTH: usize = 32;

/// Writes a literal in the shortest form.
pub(super) fn write_literal(out: &mut Vec<u8>, literal: &Literal) {
    if is_small(literal, &mut MAX_ITEMS.clone(), 0) {
        write_small(out, literal);
    } else {
        write_text(out, &summary(literal));
    }
}

/// What stands for a value that is too large.
pub(super) fn summary(literal: &Literal) -> String {
    match literal {
        Literal::Text(text) => format!("a text of {} bytes", text.len()),
        other => other.to_string(),
    }
}

fn is_small(literal: &Literal, n_left: &mut usize, depth: usize) -> bool {
    let Some(left) = n_left.checked_sub(1) else { return false };
    *n_left = left;
    match literal {
        Literal::Text(text) => text.len() <= MAX_TEXT_BYTES,
        Literal::List(items) => depth < MAX_DEPTH && items.iter().all(|item| is_small(item, n_left, depth + 1)),
        Literal::Map(items) => depth < MAX_DEPTH && items.iter().all(|(_, item)| is_small(item, n_left, depth + 1)),
        Literal::Bool(_) | Literal::Int(_) | Literal::Float(_) => true,
    }
}

fn write_small(out: &mut Vec<u8>, literal: &Literal) {
    match literal {
        Literal::Bool(value) => out.push(if *value { 0xc3 } else { 0xc2 }),
        Literal::Int(value) => write_int(out, *value),
        Literal::Float(value) => {
            out.push(0xcb);
            out.extend(value.to_be_bytes());
        }
        Literal::Text(text) => write_text(out, text),
        Literal::List(items) => {
            write_length(out, items.len(), &[(15, 0x90), (0xffff, 0xdc), (usize::MAX, 0xdd)]);
            items.iter().for_each(|item| write_small(out, item));
        }
        Literal::Map(items) => {
            write_map_length(out, items.len());
            for (key, value) in items {
                write_text(out, key);
                write_small(out, value);
            }
        }
    }
}

/// Writes the beginning of a map of `n` pairs.
pub(super) fn write_map_length(out: &mut Vec<u8>, n: usize) {
    write_length(out, n, &[(15, 0x80), (0xffff, 0xde), (usize::MAX, 0xdf)]);
}

/// Writes a text.
pub(super) fn write_text(out: &mut Vec<u8>, text: &str) {
    write_length(out, text.len(), &[(31, 0xa0), (0xff, 0xd9), (0xffff, 0xda), (usize::MAX, 0xdb)]);
    out.extend(text.as_bytes());
}

/// Writes a length with the first marker that has room: below 32 within the marker, then with 1, 2 or 4 bytes.
fn write_length(out: &mut Vec<u8>, n: usize, markers: &[(usize, u8)]) {
    let bytes = u32::try_from(n).unwrap_or(u32::MAX).to_be_bytes();
    match markers.iter().find(|(limit, _)| n <= *limit) {
        Some((limit @ (15 | 31), marker)) => out.push(marker | (bytes[3] & u8::try_from(*limit).unwrap_or(0))),
        Some((0xff, marker)) => out.extend([*marker, bytes[3]]),
        Some((0xffff, marker)) => out.extend([*marker, bytes[2], bytes[3]]),
        Some((_, marker)) => {
            out.push(*marker);
            out.extend(bytes);
        }
        None => {}
    }
}

fn write_int(out: &mut Vec<u8>, value: i64) {
    let bytes = value.to_be_bytes();
    match value {
        -32..=0x7f => out.push(bytes[7]),
        0x80..=0xff => out.extend([0xcc, bytes[7]]),
        0x100..=0xffff => out.extend([0xcd, bytes[6], bytes[7]]),
        -0x80..=-33 => out.extend([0xd0, bytes[7]]),
        -0x8000..=-0x81 => out.extend([0xd1, bytes[6], bytes[7]]),
        _ if u32::try_from(value).is_ok() => {
            out.push(0xce);
            out.extend(&bytes[4..]);
        }
        _ if i32::try_from(value).is_ok() => {
            out.push(0xd2);
            out.extend(&bytes[4..]);
        }
        _ => {
            out.push(0xd3);
            out.extend(bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(literal: impl Into<Literal>, expected: &[u8]) {
        let mut out = Vec::new();
        write_literal(&mut out, &literal.into());
        assert_eq!(out, expected);
    }

    #[test]
    fn numbers_take_the_shortest_form() {
        check(0, &[0]);
        check(127, &[0x7f]);
        check(128, &[0xcc, 128]);
        check(256, &[0xcd, 1, 0]);
        check(65_536, &[0xce, 0, 1, 0, 0]);
        check(1_i64 << 32, &[0xd3, 0, 0, 0, 1, 0, 0, 0, 0]);
        check(-1, &[0xff]);
        check(-32, &[0xe0]);
        check(-33, &[0xd0, 0xdf]);
        check(-129, &[0xd1, 0xff, 0x7f]);
        check(-32_769, &[0xd2, 0xff, 0xff, 0x7f, 0xff]);
        check(i64::MIN, &[0xd3, 0x80, 0, 0, 0, 0, 0, 0, 0]);
        check(1.5, &[0xcb, 0x3f, 0xf8, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn texts_lists_and_maps_carry_their_length() {
        check(true, &[0xc3]);
        check("ab", b"\xa2ab");
        check("x".repeat(32), &[&[0xd9, 32][..], &[b'x'; 32]].concat());
        check("x".repeat(300), &[&[0xda, 1, 44][..], &[b'x'; 300]].concat());
        check(vec![1, 2], &[0x92, 1, 2]);
        check(vec![7; 16], &[&[0xdc, 0, 16][..], &[7; 16]].concat());
        check(Literal::Map(vec![("a".to_owned(), Literal::List(vec![]))]), b"\x81\xa1a\x90");
    }

    #[test]
    fn a_large_value_is_a_summary() {
        check(vec![0; 10_000], b"\xafa list of 10000");
        check("x".repeat(70_000), b"\xb5a text of 70000 bytes");
        let deep = (0..100).fold(Literal::Int(0), |inner, _| Literal::List(vec![inner]));
        check(deep, b"\xaba list of 1");
    }
}
