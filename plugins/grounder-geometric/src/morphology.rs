//! Opening and closing of masks: the paper's clean-up of specks and holes (section IV-C).

/// Square window of half width `radius`, done as two passes of sliding sums.
fn windowed(pixels: &[u8], width: usize, height: usize, radius: usize, keep: impl Fn(usize, usize) -> bool) -> Vec<u8> {
    let pass = |source: &[u8], n_lines: usize, n: usize, line: usize, step: usize, out: &mut [u8]| {
        for l in 0..n_lines {
            let at = |i: usize| l * line + i * step;
            let mut sum: usize = (0..radius.min(n)).map(|i| usize::from(source[at(i)])).sum();
            for i in 0..n {
                if i + radius < n {
                    sum += usize::from(source[at(i + radius)]);
                }
                if i > radius {
                    sum -= usize::from(source[at(i - radius - 1)]);
                }
                let inside = (i + radius).min(n - 1) + 1 - i.saturating_sub(radius);
                out[at(i)] = u8::from(keep(sum, inside));
            }
        }
    };
    let mut rows = vec![0; pixels.len()];
    pass(pixels, height, width, width, 1, &mut rows);
    let mut out = vec![0; pixels.len()];
    pass(&rows, width, height, 1, width, &mut out);
    out
}

fn dilate(pixels: &[u8], width: usize, height: usize, radius: usize) -> Vec<u8> {
    windowed(pixels, width, height, radius, |sum, _| sum > 0)
}

fn erode(pixels: &[u8], width: usize, height: usize, radius: usize) -> Vec<u8> {
    windowed(pixels, width, height, radius, |sum, inside| sum == inside)
}

/// Removes what is narrower than `2 radius + 1` pixels.
pub(crate) fn open(pixels: &[u8], width: usize, height: usize, radius: usize) -> Vec<u8> {
    dilate(&erode(pixels, width, height, radius), width, height, radius)
}

/// Fills gaps narrower than `2 radius + 1` pixels.
pub(crate) fn close(pixels: &[u8], width: usize, height: usize, radius: usize) -> Vec<u8> {
    erode(&dilate(pixels, width, height, radius), width, height, radius)
}

/// Clears connected regions (4-neighbours) of fewer than `min_pixels`.
pub(crate) fn drop_small(pixels: &mut [u8], width: usize, min_pixels: usize) {
    let mut seen = vec![false; pixels.len()];
    let mut region = Vec::new();
    for start in 0..pixels.len() {
        if pixels[start] == 0 || seen[start] {
            continue;
        }
        region.clear();
        region.push(start);
        seen[start] = true;
        let mut next = 0;
        while let Some(&at) = region.get(next) {
            next += 1;
            let column = at % width;
            let beside = [(column > 0).then(|| at - 1), (column + 1 < width).then_some(at + 1)];
            let above = [at.checked_sub(width), (at + width < pixels.len()).then_some(at + width)];
            for other in beside.into_iter().chain(above).flatten() {
                if pixels[other] != 0 && !seen[other] {
                    seen[other] = true;
                    region.push(other);
                }
            }
        }
        if region.len() < min_pixels {
            for &at in &region {
                pixels[at] = 0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(text: &[&str]) -> (Vec<u8>, usize, usize) {
        let data = text.iter().flat_map(|line| line.bytes().map(|b| u8::from(b == b'#'))).collect();
        (data, text[0].len(), text.len())
    }

    #[track_caller]
    fn check(operation: impl Fn(&[u8], usize, usize) -> Vec<u8>, before: &[&str], after: &[&str]) {
        let (data, width, height) = pixels(before);
        assert_eq!(operation(&data, width, height), pixels(after).0);
    }

    #[test]
    fn opening_drops_specks_and_closing_fills_holes() {
        check(
            |p, w, h| open(p, w, h, 1),
            &["#......", "...###.", "...###.", "...###."],
            &[".......", "...###.", "...###.", "...###."],
        );
        let (holed, filled) = ("..##.##..", "..#####..");
        let (blank, full) = (".........", "..#####..");
        check(
            |p, w, h| close(p, w, h, 1),
            &[blank, blank, full, holed, full, blank, blank],
            &[blank, blank, full, filled, full, blank, blank],
        );
    }

    #[test]
    fn small_regions_go() {
        let (mut data, width, _) = pixels(&["##..#", "##..."]);
        drop_small(&mut data, width, 2);
        assert_eq!(data, pixels(&["##...", "##..."]).0);
    }
}
