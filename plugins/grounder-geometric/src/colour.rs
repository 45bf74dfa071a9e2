//! One colour word for a cluster, from hue and saturation, so that shading does not change it.

use crate::cloud::CloudPoint;
use sfg_types::ColourName;

/// Below this saturation (0-1) a pixel has no hue worth counting.
const MIN_SATURATION: f32 = 0.22;
/// Darker pixels have no reliable hue.
const MIN_VALUE: f32 = 0.10;

/// The dominant colour of `points`.
///
/// Each pixel votes for a hue sector or for "no hue". Lambert shading scales all channels alike, which keeps hue and
/// saturation and lowers the value; so white against grey, and orange against brown, are told apart by the bright end
/// (80th percentile) of the value within the winning sector.
pub(crate) fn dominant_colour(points: &[CloudPoint]) -> ColourName {
    // red, orange, yellow, green, blue, purple, pink, no hue
    let mut values: [Vec<f32>; 8] = Default::default();
    let mut saturations: [f32; 8] = [0.0; 8];
    for point in points {
        let (hue_deg, saturation, value) = hsv(point.rgb);
        let sector = if saturation < MIN_SATURATION || value < MIN_VALUE { 7 } else { sector(hue_deg) };
        values[sector].push(value);
        saturations[sector] += saturation;
    }
    let winner = (0..8).max_by_key(|&i| (values[i].len(), 8 - i)).unwrap_or(7);
    let n = values[winner].len();
    if n == 0 {
        return ColourName::Grey;
    }
    values[winner].sort_by(f32::total_cmp);
    let bright = values[winner][(n * 4 / 5).min(n - 1)];
    let saturation = saturations[winner] / n as f32;
    match winner {
        0 if saturation < 0.5 && bright > 0.65 => ColourName::Pink,
        0 if saturation < 0.6 && bright < 0.5 => ColourName::Brown,
        0 => ColourName::Red,
        1 if bright < 0.62 => ColourName::Brown,
        1 => ColourName::Orange,
        2 => ColourName::Yellow,
        3 => ColourName::Green,
        4 => ColourName::Blue,
        5 => ColourName::Purple,
        6 => ColourName::Pink,
        _ if bright > 0.68 => ColourName::White,
        _ if bright > 0.27 => ColourName::Grey,
        _ => ColourName::Black,
    }
}

fn sector(hue_deg: f32) -> usize {
    match hue_deg {
        h if h < 14.0 => 0,
        h if h < 42.0 => 1,
        h if h < 68.0 => 2,
        h if h < 170.0 => 3,
        h if h < 258.0 => 4,
        h if h < 300.0 => 5,
        h if h < 345.0 => 6,
        _ => 0,
    }
}

/// Hue in degrees, saturation and value in [0, 1].
fn hsv(rgb: [u8; 3]) -> (f32, f32, f32) {
    let [r, g, b] = rgb.map(|channel| f32::from(channel) / 255.0);
    let value = r.max(g).max(b);
    let chroma = value - r.min(g).min(b);
    if chroma <= 0.0 {
        return (0.0, 0.0, value);
    }
    let hue = if value == r {
        ((g - b) / chroma).rem_euclid(6.0)
    } else if value == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    (60.0 * hue, chroma / value, value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[track_caller]
    fn check(rgb: [u8; 3], expected: ColourName) {
        // Shading from full light to a third of it.
        let points: Vec<CloudPoint> = (0..90)
            .map(|i| {
                let light = 1.0 - i as f32 / 90.0 * 0.66;
                CloudPoint { position: Point3::origin(), rgb: rgb.map(|c| (f32::from(c) * light) as u8) }
            })
            .collect();
        assert_eq!(dominant_colour(&points), expected);
    }

    #[test]
    fn shaded_surfaces_keep_their_word() {
        check([200, 30, 30], ColourName::Red);
        check([240, 140, 20], ColourName::Orange);
        check([240, 220, 40], ColourName::Yellow);
        check([40, 160, 60], ColourName::Green);
        check([40, 80, 200], ColourName::Blue);
        check([130, 50, 180], ColourName::Purple);
        check([240, 150, 180], ColourName::Pink);
        check([130, 80, 40], ColourName::Brown);
        check([240, 240, 235], ColourName::White);
        check([120, 122, 125], ColourName::Grey);
        check([25, 25, 28], ColourName::Black);
    }
}
