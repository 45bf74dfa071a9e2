//! Finds the vertical axis of a round thing of which the cameras see one side.
//!
//! Cut into thin slices, a body of revolution shows arcs around one common axis. Circles through three points of a slice
//! propose the axis, all slices vote for it with the share of their points that agree on one radius, and Gauss-Newton
//! refines it over the agreeing points. So the unseen back does not pull the centre towards the cameras, a handle counts as
//! disagreement only, and the radius may change freely with height (bottles, bowls, glasses, balls). Squeezed along its long
//! direction, an oval bottle is such a body too.

use nalgebra::{Matrix2, Point3, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_geometry::{Oval, fit_ellipse};

/// Thickness of a slice: thin enough for the 45 degree wall of a bowl.
pub(crate) const SLICE_M: f32 = 0.008;
const RADIUS_BIN_M: f32 = 0.003;
const MAX_RADIUS_M: f32 = 0.20;
const N_RADIUS_BINS: usize = (MAX_RADIUS_M / RADIUS_BIN_M) as usize + 1;
/// Half width of the band around a slice's radius whose points agree: two sigmas of the depth noise.
const BAND_M: f32 = 0.0045;
const N_PROPOSALS: usize = 160;
const N_VOTERS: usize = 900;
const N_REFINERS: usize = 5000;
const N_SECTORS: usize = 24;
/// Rounder things are round, flatter ones are boards.
const OVAL_ASPECTS: std::ops::Range<f64> = 1.12..2.8;
/// Slices with fewer points have no radius of their own.
const MIN_SLICE_POINTS: usize = 12;

/// One slice of a body of revolution.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slice {
    /// Height of its middle, base frame.
    pub(crate) z_m: f32,
    /// Radius on which most of its points agree; of ovals the geometric mean.
    pub(crate) radius_m: f32,
}

/// A vertical axis with the radius along it.
#[derive(Clone, Debug)]
pub(crate) struct Revolution {
    /// Axis, base frame.
    pub(crate) centre: [f32; 2],
    /// Form of the cross-section, the same at every height.
    pub(crate) oval: Oval,
    /// From the bottom up, empty slices left out.
    pub(crate) slices: Vec<Slice>,
    /// Share of the points that agree with their slice, 0 to 1.
    pub(crate) support: f32,
    /// Share of the 24 directions around the axis in which agreeing points were seen, 0 to 1.
    pub(crate) coverage: f32,
}

impl Revolution {
    /// Distance of (x, y) from the axis; of ovals the mean radius of the one through it.
    pub(crate) fn distance(&self, x: f32, y: f32) -> f32 {
        let offset = Vector2::new(x - self.centre[0], y - self.centre[1]);
        if self.oval.aspect <= 1.0 { offset.norm() } else { self.oval.radius_through_m(&offset.cast()) as f32 }
    }

    /// Radius at height `z_m`, that of the nearest slice.
    pub(crate) fn radius_at(&self, z_m: f32) -> f32 {
        self.slices.iter().min_by(|a, b| (a.z_m - z_m).abs().total_cmp(&(b.z_m - z_m).abs())).map_or(0.0, |s| s.radius_m)
    }

    /// Largest radius over the height.
    pub(crate) fn max_radius_m(&self) -> f32 {
        self.slices.iter().map(|slice| slice.radius_m).fold(0.0, f32::max)
    }
}

/// The best vertical axis of `points` above `bottom_z_m`; always one when there are enough points, so look at `support` and `coverage`.
pub(crate) fn fit_revolution(points: &[Point3<f32>], bottom_z_m: f32) -> Option<Revolution> {
    let voters = thinned(points, N_VOTERS);
    if voters.len() < 3 * MIN_SLICE_POINTS {
        return None;
    }
    let n_slices = voters.iter().map(|p| slice_of(p, bottom_z_m)).max()? + 1;
    let mut by_slice: Vec<Vec<usize>> = vec![Vec::new(); n_slices];
    for (i, point) in voters.iter().enumerate() {
        by_slice[slice_of(point, bottom_z_m)].push(i);
    }
    // The stream depends on nothing, so the same cloud always has the same axis.
    let mut rng = ChaCha8Rng::seed_from_u64(0x5f6);
    let mut votes = Votes::new(n_slices);
    let mut best: Option<(f32, [f32; 2])> = None;
    for _ in 0..N_PROPOSALS {
        let first = rng.random_range(0..voters.len());
        let mates = &by_slice[slice_of(&voters[first], bottom_z_m)];
        let (second, third) = (mates[rng.random_range(0..mates.len())], mates[rng.random_range(0..mates.len())]);
        let Some(centre) = circle_centre(&voters[first], &voters[second], &voters[third]) else { continue };
        votes.count(&voters, centre, bottom_z_m);
        // Coverage only lowers the score, and costs an arctangent a point.
        if best.is_some_and(|(top, _)| votes.support(&voters, centre, bottom_z_m) <= top) {
            continue;
        }
        let (support, coverage) = votes.verdict(&voters, centre, bottom_z_m);
        // Half a turn of evidence is as good as a whole one; less may be a straight edge seen as a flat arc.
        let score = support * (2.0 * coverage).min(1.0);
        if best.is_none_or(|(top, _)| score > top) {
            best = Some((score, centre));
        }
    }
    let (_, centre) = best?;
    Some(refine(&thinned(points, N_REFINERS), centre, bottom_z_m, n_slices + 1))
}

/// The best body of oval cross-section; `None` when its outline is nearly round or too flat for one.
pub(crate) fn fit_oval(points: &[Point3<f32>], bottom_z_m: f32, top_z_m: f32) -> Option<Revolution> {
    // Foot, shoulder and cap often have other forms than the body.
    let band = bottom_z_m + 0.1 * (top_z_m - bottom_z_m)..bottom_z_m + 0.6 * (top_z_m - bottom_z_m);
    let outline: Vec<Vector2<f64>> =
        thinned(points, N_REFINERS).iter().filter(|p| band.contains(&p.z)).map(|p| p.xy().coords.cast()).collect();
    let (_, oval, _) = fit_ellipse(&outline)?;
    if !OVAL_ASPECTS.contains(&oval.aspect) {
        return None;
    }
    let squeeze = oval.squeeze().cast::<f32>();
    let squeezed = |p: &Point3<f32>| {
        let xy = squeeze * p.xy().coords;
        Point3::new(xy.x, xy.y, p.z)
    };
    let round = fit_revolution(&points.iter().map(squeezed).collect::<Vec<_>>(), bottom_z_m)?;
    let centre = oval.stretch().cast::<f32>() * Vector2::from(round.centre);
    Some(Revolution { centre: [centre.x, centre.y], oval, ..round })
}

/// At most about `n` of the points, evenly taken.
pub(crate) fn thinned(points: &[Point3<f32>], n: usize) -> Vec<Point3<f32>> {
    points.iter().step_by(points.len().div_ceil(n.max(1)).max(1)).copied().collect()
}

fn slice_of(point: &Point3<f32>, bottom_z_m: f32) -> usize {
    ((point.z - bottom_z_m).max(0.0) / SLICE_M) as usize
}

/// Centre of the circle through three points seen from above; `None` when its radius is no hand-sized thing's.
fn circle_centre(a: &Point3<f32>, b: &Point3<f32>, c: &Point3<f32>) -> Option<[f32; 2]> {
    let (bx, by, cx, cy) = (b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y);
    let double_area = bx * cy - by * cx;
    if double_area.abs() < 2e-5 {
        return None;
    }
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    let (ux, uy) = ((cy * b2 - by * c2) / (2.0 * double_area), (bx * c2 - cx * b2) / (2.0 * double_area));
    let radius = ux.hypot(uy);
    (0.006..MAX_RADIUS_M).contains(&radius).then_some([a.x + ux, a.y + uy])
}

/// Radius histograms of all slices, reused between proposals.
struct Votes {
    histograms: Vec<[u16; N_RADIUS_BINS]>,
    /// Middle of the winning three bins of each slice.
    modes: Vec<f32>,
}

impl Votes {
    fn new(n_slices: usize) -> Self {
        Self { histograms: vec![[0; N_RADIUS_BINS]; n_slices], modes: vec![0.0; n_slices] }
    }

    fn count(&mut self, voters: &[Point3<f32>], centre: [f32; 2], bottom_z_m: f32) {
        for histogram in &mut self.histograms {
            histogram.fill(0);
        }
        for point in voters {
            let bin = ((point.x - centre[0]).hypot(point.y - centre[1]) / RADIUS_BIN_M) as usize;
            if bin < N_RADIUS_BINS {
                self.histograms[slice_of(point, bottom_z_m)][bin] += 1;
            }
        }
        for (histogram, mode) in self.histograms.iter().zip(&mut self.modes) {
            let triple = |i: usize| u32::from(histogram[i - 1]) + u32::from(histogram[i]) + u32::from(histogram[i + 1]);
            let bin = (1..N_RADIUS_BINS - 1).max_by_key(|&i| (triple(i), i)).unwrap_or(1);
            *mode = (bin as f32 + 0.5) * RADIUS_BIN_M;
        }
    }

    /// Share of agreeing points.
    fn support(&self, voters: &[Point3<f32>], centre: [f32; 2], bottom_z_m: f32) -> f32 {
        let agrees = |point: &&Point3<f32>| {
            let distance = (point.x - centre[0]).hypot(point.y - centre[1]);
            (distance - self.modes[slice_of(point, bottom_z_m)]).abs() < BAND_M
        };
        voters.iter().filter(agrees).count() as f32 / voters.len() as f32
    }

    /// Share of agreeing points and share of directions in which they lie.
    fn verdict(&self, voters: &[Point3<f32>], centre: [f32; 2], bottom_z_m: f32) -> (f32, f32) {
        let mut n_agreeing = 0_usize;
        let mut sectors = [0_u16; N_SECTORS];
        for point in voters {
            let (x, y) = (point.x - centre[0], point.y - centre[1]);
            if (x.hypot(y) - self.modes[slice_of(point, bottom_z_m)]).abs() < BAND_M {
                n_agreeing += 1;
                sectors[sector(x, y)] += 1;
            }
        }
        (n_agreeing as f32 / voters.len() as f32, coverage(&sectors, n_agreeing))
    }
}

fn sector(x: f32, y: f32) -> usize {
    let turn = y.atan2(x) / std::f32::consts::TAU + 0.5;
    ((turn * N_SECTORS as f32) as usize).min(N_SECTORS - 1)
}

/// A direction counts from a fifth of its fair share of points.
fn coverage(sectors: &[u16; N_SECTORS], n_agreeing: usize) -> f32 {
    let enough = (n_agreeing / (5 * N_SECTORS)).max(1);
    sectors.iter().filter(|&&n| usize::from(n) >= enough).count() as f32 / N_SECTORS as f32
}

fn refine(points: &[Point3<f32>], mut centre: [f32; 2], bottom_z_m: f32, n_slices: usize) -> Revolution {
    let mut votes = Votes::new(n_slices.max(points.iter().map(|p| slice_of(p, bottom_z_m)).max().unwrap_or(0) + 1));
    let mut radii = Vec::new();
    for _ in 0..6 {
        votes.count(points, centre, bottom_z_m);
        radii = agreed_radii(points, centre, bottom_z_m, &votes.modes);
        let (mut normal, mut right) = (Matrix2::<f32>::zeros(), Vector2::<f32>::zeros());
        for point in points {
            let offset = Vector2::new(point.x - centre[0], point.y - centre[1]);
            let (distance, (radius, _)) = (offset.norm(), radii[slice_of(point, bottom_z_m)]);
            let miss = distance - radius;
            if miss.abs() < 1.5 * BAND_M && radius > 0.004 {
                // Tukey's weight: points between wall and handle fade out.
                let weight = (1.0 - (miss / (1.5 * BAND_M)).powi(2)).powi(2);
                let direction = offset / distance;
                normal += direction * direction.transpose() * weight;
                right += direction * (miss * weight);
            }
        }
        let Some(step) = normal.try_inverse().map(|inverse| inverse * right) else { break };
        centre = [centre[0] + step.x.clamp(-0.01, 0.01), centre[1] + step.y.clamp(-0.01, 0.01)];
        if step.norm() < 2e-5 {
            break;
        }
    }
    votes.count(points, centre, bottom_z_m);
    let (support, coverage) = votes.verdict(points, centre, bottom_z_m);
    let slices = radii
        .iter()
        .enumerate()
        .filter(|(_, (_, n))| *n >= MIN_SLICE_POINTS)
        .map(|(i, &(radius_m, _))| Slice { z_m: bottom_z_m + (i as f32 + 0.5) * SLICE_M, radius_m })
        .collect();
    Revolution { centre, oval: Oval::ROUND, slices, support, coverage }
}

/// Mean distance of the points in each slice's band, and how many there are.
fn agreed_radii(points: &[Point3<f32>], centre: [f32; 2], bottom_z_m: f32, modes: &[f32]) -> Vec<(f32, usize)> {
    let mut sums = vec![(0.0_f32, 0_usize); modes.len()];
    for point in points {
        let slice = slice_of(point, bottom_z_m);
        let distance = (point.x - centre[0]).hypot(point.y - centre[1]);
        if (distance - modes[slice]).abs() < 1.3 * BAND_M {
            sums[slice].0 += distance;
            sums[slice].1 += 1;
        }
    }
    sums.into_iter().map(|(sum, n)| (if n > 0 { sum / n as f32 } else { 0.0 }, n)).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    /// The side of a cone seen from -X over `arc_rad`, with a noise of 2.5 mm along the view.
    fn seen_cone(centre: [f32; 2], radius: impl Fn(f32) -> f32, height: f32, arc_rad: f32, seed: u64) -> Vec<Point3<f32>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..3000)
            .map(|_| {
                let z = rng.random_range(0.0..height);
                let angle = std::f32::consts::PI + rng.random_range(-0.5..0.5_f32) * arc_rad;
                let noise = 0.0025 * ((0..12).map(|_| rng.random_range(0.0..1.0_f32)).sum::<f32>() - 6.0);
                Point3::new(centre[0] + radius(z) * angle.cos() + noise, centre[1] + radius(z) * angle.sin(), z)
            })
            .collect()
    }

    #[track_caller]
    fn check(radius: impl Fn(f32) -> f32, height: f32, arc_deg: f32, tolerance_m: f32) {
        for seed in 0..5 {
            let points = seen_cone([0.61, -0.13], &radius, height, arc_deg.to_radians(), seed);
            let fit = fit_revolution(&points, 0.0).unwrap();
            let miss = (fit.centre[0] - 0.61).hypot(fit.centre[1] + 0.13);
            assert!(miss < tolerance_m, "seed {seed}: axis off by {miss} m");
            assert!(fit.support > 0.6, "seed {seed}: support {}", fit.support);
            let middle = height / 2.0;
            assert!((fit.radius_at(middle) - radius(middle)).abs() < 0.004, "radius {}", fit.radius_at(middle));
        }
    }

    #[test]
    fn axis_is_found_from_one_side() {
        check(|_| 0.035, 0.20, 200.0, 0.004);
        check(|_| 0.040, 0.09, 170.0, 0.006);
        check(|z| 0.04 + 0.6 * z, 0.06, 300.0, 0.004);
        check(|z| if z < 0.14 { 0.035 } else { 0.014 }, 0.20, 200.0, 0.004);
    }

    #[test]
    fn straight_wall_has_little_coverage() {
        let points: Vec<_> = (0..2000).map(|i| Point3::new(0.6, (i % 50) as f32 * 0.002, (i / 50) as f32 * 0.003)).collect();
        let fit = fit_revolution(&points, 0.0);
        assert!(fit.is_none_or(|fit| fit.coverage < 0.4), "a wall must not look round");
    }
}
