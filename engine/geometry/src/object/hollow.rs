//! Turns a closed scan into an open vessel: cuts it off at a mouth and bores a round cavity from there.

use super::piece::LabelledPiece;
use super::profile::Profile;
use super::scanned::{MeshDistance, Vessel, hull_piece, offset_outwards};
use crate::mesh::{self, TriMesh};
use nalgebra::{Point3, Vector3};
use std::f64::consts::TAU;

/// How a scan that is a closed solid, such as a bottle with its cap on, becomes a vessel.
///
/// The scan is cut off level at the mouth, and a cavity of revolution about a vertical axis is taken out of what is left. The
/// axis is the one with the most room in the upper half. At each height the cavity is as wide as the *narrowest* side of the scan
/// allows, and its side slants by at most 45 degrees: a flat bottle becomes a thick-walled vessel with a round hollow, and holds
/// less than the real one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hollow {
    /// Height of the cut over the base, metres; at least the wall below the top of the scan.
    pub mouth_m: f64,
    /// Thickness of wall and floor where they are thinnest, metres; at least 0.003.
    pub wall_m: f64,
}

/// Thinner staves let grains through.
const MIN_WALL_M: f64 = 3e-3;
/// A narrower cavity jams two grains of 4 mm side by side.
const MIN_RADIUS_M: f64 = 8e-3;
/// A shallower cavity holds nothing worth pouring.
const MIN_DEPTH_M: f64 = 0.02;
/// Distance between two heights at which the room is measured.
const LEVEL_M: f64 = 1.5e-3;
const N_AROUND: usize = 48;
/// How much radius a straight piece of the profile may give away: few pieces make few staves.
const STRAIGHT_WITHIN_M: f64 = 0.7e-3;
/// Edge of the cells that the bored surface is made of: less than the thinnest wall.
const SURFACE_M: f64 = 2e-3;
/// The single precision of the scan's distances, with room to spare.
const NOISE_M: f64 = 1e-4;

/// The surface and the walls of a scan whose base lies at height 0, or what is wrong with the wish.
pub(super) fn bore(scan: &MeshDistance, hollow: &Hollow) -> Result<(TriMesh, Vessel), String> {
    let Hollow { mouth_m, wall_m } = *hollow;
    let (low, high) = scan.mesh().bounds().ok_or("the scan is empty")?;
    if !(wall_m >= MIN_WALL_M && wall_m.is_finite()) {
        return Err(format!("wall_m is {wall_m} m, grains leak through walls under {MIN_WALL_M} m"));
    }
    let (least, most) = (wall_m + MIN_DEPTH_M, high.z - wall_m);
    if !(least..=most).contains(&mouth_m) {
        return Err(format!(
            "mouth_m is {mouth_m} m, expected {least:.3} m (the floor and a depth of 0.02 m) to {most:.3} m (the top less the wall)"
        ));
    }
    let inside = nalgebra::center(&low, &Point3::new(high.x, high.y, mouth_m));
    if scan.signed_distance(&inside) > 0.0 {
        return Err("the scan is hollow already: it has no material in its middle to bore".to_owned());
    }
    let axis = roomiest_axis(scan, &low, &high, mouth_m);
    let inner = cavity(scan, axis, hollow)?;
    let floor = inner[0];
    let vessel = Vessel {
        axis,
        outer: offset_outwards(&inner, wall_m),
        // No wider than the cavity: the scan may be rounded at its base.
        floor_radius: floor[0] + 0.5e-3,
        inner,
        wall: wall_m,
    };
    let mesh = surface(scan, &vessel, mouth_m)?;
    Ok((mesh, vessel))
}

/// The vertical axis that stays farthest from the surface between half the mouth's height and the mouth.
fn roomiest_axis(scan: &MeshDistance, low: &Point3<f64>, high: &Point3<f64>, mouth_m: f64) -> [f64; 2] {
    const N_HEIGHTS: usize = 6;
    const N_GRID: usize = 12;
    let room = |[x, y]: [f64; 2]| {
        (0..N_HEIGHTS)
            .map(|i| -scan.signed_distance(&Point3::new(x, y, mouth_m * (0.5 + 0.5 * i as f64 / (N_HEIGHTS - 1) as f64))))
            .fold(f64::INFINITY, f64::min)
    };
    let middle = [(low.x + high.x) / 2.0, (low.y + high.y) / 2.0];
    let mut best = (middle, room(middle));
    let take_better = |at: [f64; 2], best: &mut ([f64; 2], f64)| {
        let found = room(at);
        if found > best.1 + NOISE_M {
            *best = (at, found);
        }
    };
    for i in 1..N_GRID {
        for j in 1..N_GRID {
            let along = |low: f64, high: f64, k: usize| low + (high - low) * k as f64 / N_GRID as f64;
            take_better([along(low.x, high.x, i), along(low.y, high.y, j)], &mut best);
        }
    }
    let mut step = (high - low).xy().max() / N_GRID as f64;
    while step > 2e-4 {
        let from = best.0;
        for [dx, dy] in [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]] {
            take_better([from[0] + dx, from[1] + dy], &mut best);
        }
        if best.0 == from {
            step /= 2.0;
        }
    }
    best.0
}

/// `[radius, height]` of the cavity from floor to mouth: nowhere nearer to the scan's surface than the wall, in few straight pieces.
fn cavity(scan: &MeshDistance, axis: [f64; 2], hollow: &Hollow) -> Result<Vec<[f64; 2]>, String> {
    use rayon::prelude::*;
    let Hollow { mouth_m, wall_m } = *hollow;
    let n_levels = ((mouth_m - wall_m) / LEVEL_M).ceil() as usize;
    let mut levels: Vec<[f64; 2]> = (0..=n_levels)
        .into_par_iter()
        .map(|level| {
            let z = wall_m + (mouth_m - wall_m) * level as f64 / n_levels as f64;
            [room_around(scan, axis, z, wall_m), z]
        })
        .collect();
    // The base may be dented: the floor lies above the dent.
    let n_dented = levels.iter().take_while(|level| level[0] < MIN_RADIUS_M).count();
    let too_narrow = |[radius, z]: [f64; 2]| {
        let radius_mm = 1000.0 * radius;
        format!("a wall of {wall_m} m leaves a radius of {radius_mm:.1} mm at the height of {z:.3} m, grains need 8 mm")
    };
    let is_deep = levels.get(n_dented).is_some_and(|floor| mouth_m - floor[1] >= MIN_DEPTH_M - NOISE_M);
    if !is_deep {
        return Err(too_narrow(levels[n_dented.saturating_sub(1)]));
    }
    levels.drain(..n_dented);
    // The lip is upright, so that its staves end level at the mouth.
    let lip_idx = levels.partition_point(|level| level[1] < mouth_m - wall_m).min(levels.len() - 2);
    let lip_radius = levels[lip_idx..].iter().map(|level| level[0]).fold(f64::INFINITY, f64::min);
    levels[lip_idx][0] = lip_radius;
    // The side slants by at most 45 degrees: grains that are poured find no ledge, and staves meet at blunt angles.
    for idx in (0..lip_idx).rev() {
        levels[idx][0] = levels[idx][0].min(levels[idx + 1][0] + levels[idx + 1][1] - levels[idx][1]);
    }
    for idx in 1..=lip_idx {
        levels[idx][0] = levels[idx][0].min(levels[idx - 1][0] + levels[idx][1] - levels[idx - 1][1]);
    }
    let lip_radius = levels[lip_idx][0];
    levels[lip_idx..].iter_mut().for_each(|level| level[0] = lip_radius);
    let mut kept = vec![0, lip_idx, levels.len() - 1];
    kept.dedup();
    keep_corners(&levels, 0, lip_idx, &mut kept);
    kept.sort_unstable();
    // Straight pieces cut corners: all of them give way by as much as the worst of them does.
    let excess = kept
        .windows(2)
        .flat_map(|w| (w[0]..=w[1]).map(|idx| chord(&levels, w[0], w[1], idx) - levels[idx][0]))
        .fold(0.0, f64::max);
    let profile: Vec<[f64; 2]> = kept.iter().map(|&idx| [levels[idx][0] - excess, levels[idx][1]]).collect();
    match profile.iter().find(|point| point[0] < MIN_RADIUS_M) {
        Some(point) => Err(too_narrow(*point)),
        None => Ok(profile),
    }
}

/// Largest radius about the axis, at one height, within which every point is at least the wall away from the surface.
fn room_around(scan: &MeshDistance, axis: [f64; 2], z: f64, wall_m: f64) -> f64 {
    const LEAST_STEP_M: f64 = 2e-4;
    let mut narrowest = f64::INFINITY;
    for i in 0..N_AROUND {
        let (sin, cos) = (TAU * i as f64 / N_AROUND as f64).sin_cos();
        let (mut good, mut next) = (0.0, 0.0);
        while good < narrowest {
            let room = -scan.signed_distance(&Point3::new(axis[0] + cos * next, axis[1] + sin * next, z)) - wall_m;
            // A full step lands where the room is just used up: within the noise that is still good.
            if room < -NOISE_M {
                break;
            }
            good = next;
            next += room.max(LEAST_STEP_M);
        }
        narrowest = narrowest.min(good);
    }
    narrowest
}

/// Radius at level `idx` of the straight line between two levels.
fn chord(levels: &[[f64; 2]], from: usize, to: usize, idx: usize) -> f64 {
    let ([r0, z0], [r1, z1]) = (levels[from], levels[to]);
    r0 + (r1 - r0) * (levels[idx][1] - z0) / (z1 - z0)
}

/// Adds the levels between two kept ones at which a straight line would be too far off (Douglas and Peucker).
fn keep_corners(levels: &[[f64; 2]], from: usize, to: usize, kept: &mut Vec<usize>) {
    let off = |idx: usize| (chord(levels, from, to, idx) - levels[idx][0]).abs();
    let Some(worst) = (from + 1..to).max_by(|&a, &b| off(a).total_cmp(&off(b))) else { return };
    if off(worst) > STRAIGHT_WITHIN_M {
        kept.push(worst);
        keep_corners(levels, from, worst, kept);
        keep_corners(levels, worst, to, kept);
    }
}

/// The closed surface of the cut and bored scan.
fn surface(scan: &MeshDistance, vessel: &Vessel, mouth_m: f64) -> Result<TriMesh, String> {
    let (low, high) = scan.mesh().bounds().ok_or("the scan is empty")?;
    let mut profile = vessel.inner.clone();
    let lip_radius = profile[profile.len() - 1][0];
    profile.push([lip_radius, mouth_m + 0.05]);
    let cavity = Profile::solid(&profile)?;
    let distance = |p: &Point3<f64>| {
        let taken_out = (p.z - mouth_m).max(-cavity.signed_distance((p.x - vessel.axis[0]).hypot(p.y - vessel.axis[1]), p.z));
        // Deep in what is taken out the scan has no say.
        if taken_out > 2.0 * SURFACE_M { taken_out } else { taken_out.max(scan.signed_distance(p)) }
    };
    Ok(mesh::surface_of(&distance, &low, &Point3::new(high.x, high.y, mouth_m), SURFACE_M))
}

/// The part of a convex group below the mouth, if it is more than a sliver.
pub(super) fn cut_hull(group: &TriMesh, mouth_m: f64) -> Option<LabelledPiece> {
    const SLIVER_M: f64 = 1e-3;
    let (low, high) = group.bounds()?;
    if high.z <= mouth_m {
        return Some(hull_piece(&group.vertices));
    }
    if low.z > mouth_m - SLIVER_M {
        return None;
    }
    let hull = mesh::convex_hull(&group.vertices);
    let mut points: Vec<Point3<f64>> = hull.vertices.iter().copied().filter(|v| v.z <= mouth_m).collect();
    for idx in 0..hull.triangles.len() {
        let corners = hull.corners(idx);
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (corners[i], corners[j])) {
            // Each edge belongs to two triangles that run along it in opposite directions: once is enough.
            if a.z < mouth_m && b.z > mouth_m {
                let crossing: Vector3<f64> = (b - a) * ((mouth_m - a.z) / (b.z - a.z));
                points.push(Point3::new(a.x + crossing.x, a.y + crossing.y, mouth_m));
            }
        }
    }
    (points.len() > 3).then(|| hull_piece(&points))
}
