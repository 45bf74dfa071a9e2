//! Fits a solid of revolution, one of oval cross-section or a box to a half-seen surface; the fit stands in for the side that no camera
//! saw.

use nalgebra::{Matrix3, SymmetricEigen, Unit, UnitQuaternion, Vector2};
use sfg_geometry::{Oval, fit_ellipse};
use sfg_types::{Point, Pose, Vector};

/// Normals that lean this much along the axis belong to an end of a solid of revolution: sine of 37 degrees.
const MAX_SIDE_SLOPE: f64 = 0.6;
/// Shorter than this many radii, a solid of revolution has no side to speak of.
const MIN_SLENDERNESS: f64 = 2.5;
/// Length of one step of a revolution's profile, metres.
const PROFILE_STEP_M: f64 = 0.0075;
/// A fit this good is taken without trying a smaller neighbourhood, metres rms: half a voxel.
const GOOD_RMS_M: f64 = 0.004;
/// Fewer samples are always easier to fit, so a smaller neighbourhood must fit this much better.
const LOCAL_GAIN: f64 = 0.6;
/// A later axis candidate must be better by this much, metres, so that noise does not tilt an upright bottle.
const AXIS_PREFERENCE_M: f64 = 0.001;
/// Smallest variance of the normals across the axis: an arc of about +-30 degrees. Less does not determine a radius.
const MIN_NORMAL_VARIANCE: f64 = 0.06;
/// Something whose lowest seen point is this close to the table stands or lies on it, metres.
const ON_TABLE_M: f64 = 0.04;
/// Rounder things are round, flatter ones are boards.
const OVAL_ASPECTS: std::ops::Range<f64> = 1.1..3.0;
/// Where a bottle has its body, shares of the height.
const BODY: std::ops::Range<f64> = 0.1..0.6;
/// Fewest samples of a fit.
const MIN_SAMPLES: usize = 12;

/// A surface point with its outward normal, base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Point on the surface, metres.
    pub point: Point,
    /// Unit normal into free space.
    pub normal: Vector,
}

/// A completed solid.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A profile turned about an axis.
    Revolution {
        /// A point on the axis, base frame.
        origin: Point,
        /// Direction of the axis.
        axis: Unit<Vector>,
        /// Form of the cross-section; round unless the axis is upright.
        oval: Oval,
        /// Where the profile begins along the axis, measured from `origin`, metres.
        from_m: f64,
        /// Where it ends, metres.
        to_m: f64,
        /// Radii at steps of `PROFILE_STEP_M`, metres; at least one. Of ovals the mean radius.
        radii_m: Vec<f64>,
    },
    /// A box about its centre.
    Cuboid {
        /// Pose of the centre.
        base_from_box: Pose,
        /// Half side lengths, metres.
        half_m: Vector,
    },
}

/// A shape and how well the seen surface lies on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The completed solid.
    pub shape: Shape,
    /// Root mean square distance of the samples, metres.
    pub rms_m: f64,
}

impl Shape {
    /// Approximate signed distance, metres, positive outside. Exact on cylinders and boxes.
    #[must_use]
    pub fn distance(&self, point: &Point) -> f64 {
        match self {
            Self::Revolution { origin, axis, oval, from_m, to_m, radii_m } => {
                let offset = point - origin;
                let along = offset.dot(axis);
                let radius_m = radius_at(*from_m, radii_m, along);
                let side = if oval.aspect > 1.0 {
                    oval.distance_m(&offset.xy(), radius_m)
                } else {
                    (offset - axis.into_inner() * along).norm() - radius_m
                };
                let end = (from_m - along).max(along - to_m);
                outside_corner(side, end)
            }
            Self::Cuboid { base_from_box, half_m } => {
                let local = base_from_box.inverse_transform_point(point);
                let excess = local.coords.abs() - half_m;
                excess.map(|e| e.max(0.0)).norm() + excess.max().min(0.0)
            }
        }
    }

    /// Whether a surface normal belongs to the side of the shape and not to an end. Boxes and round things as short as a ball
    /// have no ends.
    #[must_use]
    pub fn is_side(&self, normal: &Vector) -> bool {
        match self {
            Self::Revolution { axis, from_m, to_m, radii_m, .. } => {
                let radius_m = radii_m.iter().copied().fold(0.0, f64::max);
                to_m - from_m < MIN_SLENDERNESS * radius_m || normal.dot(axis).abs() < MAX_SIDE_SLOPE
            }
            Self::Cuboid { .. } => true,
        }
    }

    /// Direction of the axis; a box has none of its own.
    #[must_use]
    pub fn axis(&self) -> Option<Vector> {
        match self {
            Self::Revolution { axis, .. } => Some(axis.into_inner()),
            Self::Cuboid { .. } => None,
        }
    }

    /// Radius (geometric mean of an oval, half the smaller width of a box) at the height of `point`, metres.
    #[must_use]
    pub fn mean_radius_m(&self, point: &Point) -> f64 {
        match self {
            Self::Revolution { origin, axis, from_m, radii_m, .. } => radius_at(*from_m, radii_m, (point - origin).dot(axis)),
            Self::Cuboid { half_m, .. } => half_m.xy().min(),
        }
    }

    /// Radius (half the smaller width for an oval or a box) where the shape is nearest to `point`, metres.
    #[must_use]
    pub fn radius_near_m(&self, point: &Point) -> f64 {
        let mean_m = self.mean_radius_m(point);
        match self {
            Self::Revolution { oval, .. } => oval.half_axes_m(mean_m)[1],
            Self::Cuboid { .. } => mean_m,
        }
    }
}

/// Positions inside `samples` that the shape does not explain within `tolerance_m`.
#[must_use]
pub fn unexplained(shape: &Shape, samples: &[Sample], tolerance_m: f64) -> Vec<Sample> {
    samples.iter().filter(|s| shape.distance(&s.point).abs() > tolerance_m).copied().collect()
}

/// The best shape for the surface around `near`, or `None` when there are too few samples.
///
/// All samples are tried first, then smaller neighbourhoods of `near`: a mug's handle is a ring as a whole and a short
/// cylinder where the fingers go. Things that reach down to the table are completed to it.
#[must_use]
pub fn fit_near(samples: &[Sample], near: &Point, table_height_m: f64) -> Option<Fit> {
    let mut best: Option<Fit> = None;
    for reach_m in [f64::INFINITY, 0.045, 0.025] {
        let close: Vec<Sample> = samples.iter().filter(|s| (s.point - near).norm() <= reach_m).copied().collect();
        let Some(fit) = fit(&close, table_height_m) else { continue };
        if best.as_ref().is_none_or(|b| fit.rms_m < b.rms_m * LOCAL_GAIN) {
            best = Some(fit);
        }
        if best.as_ref().is_some_and(|b| b.rms_m <= GOOD_RMS_M) {
            break;
        }
    }
    best
}

/// The best of a solid of revolution, an upright one of oval cross-section and a box.
#[must_use]
pub fn fit(samples: &[Sample], table_height_m: f64) -> Option<Fit> {
    if samples.len() < MIN_SAMPLES {
        return None;
    }
    let mut best: Option<Fit> = None;
    let round = axis_candidates(samples).map(|axis| Some((axis, Oval::ROUND)));
    let oval = oval_form(samples).map(|oval| (Vector::z_axis(), oval));
    for (axis, oval) in round.into_iter().chain([oval]).flatten() {
        let Some(candidate) = fit_revolution(samples, axis, oval, table_height_m) else { continue };
        if best.as_ref().is_none_or(|b| candidate.rms_m < b.rms_m - AXIS_PREFERENCE_M) {
            best = Some(candidate);
        }
    }
    let cuboid = fit_cuboid(samples, table_height_m);
    if best.as_ref().is_none_or(|b| cuboid.rms_m < b.rms_m - AXIS_PREFERENCE_M) {
        best = Some(cuboid);
    }
    best
}

/// The form of an upright thing's outline, when it is oval.
fn oval_form(samples: &[Sample]) -> Option<Oval> {
    // Foot, shoulder and cap often have other forms than the body.
    let heights = samples.iter().map(|s| s.point.z);
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
    let body = low + BODY.start * (high - low)..low + BODY.end * (high - low);
    let is_outline = |s: &&Sample| s.normal.z.abs() < MAX_SIDE_SLOPE && body.contains(&s.point.z);
    let outline: Vec<Vector2<f64>> = samples.iter().filter(is_outline).map(|s| s.point.coords.xy()).collect();
    fit_ellipse(&outline).map(|(_, oval, _)| oval).filter(|oval| OVAL_ASPECTS.contains(&oval.aspect))
}

/// Upright first, then the direction that no normal points along, then the longest extent.
fn axis_candidates(samples: &[Sample]) -> [Unit<Vector>; 3] {
    let n = samples.len() as f64;
    let mean = samples.iter().map(|s| s.point.coords).sum::<Vector>() / n;
    let mut of_points = Matrix3::zeros();
    let mut of_normals = Matrix3::zeros();
    for sample in samples {
        let offset = sample.point.coords - mean;
        of_points += offset * offset.transpose();
        of_normals += sample.normal * sample.normal.transpose();
    }
    let points = SymmetricEigen::new(of_points);
    let normals = SymmetricEigen::new(of_normals);
    let longest = points.eigenvectors.column(points.eigenvalues.imax()).into_owned();
    let bare = normals.eigenvectors.column(normals.eigenvalues.imin()).into_owned();
    [Vector::z_axis(), towards_plus(bare), towards_plus(longest)]
}

/// One of the two directions of a line, chosen alike for a scene and its mirror image in y.
fn towards_plus(direction: Vector) -> Unit<Vector> {
    let flip = if direction.x.abs() > 1e-3 { direction.x < 0.0 } else { direction.z < 0.0 };
    Unit::new_normalize(if flip { -direction } else { direction })
}

/// Centre and radius from `p = c + r n` across the axis, which is exact on cylinders and on spheres; then the profile. An oval is squeezed
/// round first.
fn fit_revolution(samples: &[Sample], axis: Unit<Vector>, oval: Oval, table_height_m: f64) -> Option<Fit> {
    let e1 = if axis.z.abs() > 0.9 { Vector::x() } else { Vector::z().cross(&axis).normalize() };
    let e1 = (e1 - axis.into_inner() * e1.dot(&axis)).normalize();
    let e2 = axis.cross(&e1);
    let (squeeze, stretch) = (oval.squeeze(), oval.stretch());
    let flat = |v: &Vector| squeeze * Vector2::new(v.dot(&e1), v.dot(&e2));
    let flat_normal = |n: &Vector| {
        let across = Vector2::new(n.dot(&e1), n.dot(&e2));
        let turned = stretch * across;
        turned * (across.norm() / turned.norm().max(1e-9))
    };
    let mut side: Vec<(Vector2<f64>, Vector2<f64>, f64)> = samples
        .iter()
        .map(|s| (flat(&s.point.coords), flat_normal(&s.normal), s.point.coords.dot(&axis)))
        .filter(|(_, m, _)| m.norm() > 0.5)
        .collect();
    if side.len() < MIN_SAMPLES || side.len() * 5 < samples.len() * 2 {
        return None;
    }
    let mut centre = Vector2::zeros();
    let mut radius_m = 0.0;
    for pass in 0..3 {
        let n = side.len() as f64;
        let mean_p = side.iter().map(|s| s.0).sum::<Vector2<f64>>() / n;
        let mean_m = side.iter().map(|s| s.1).sum::<Vector2<f64>>() / n;
        let variance = side.iter().map(|s| (s.1 - mean_m).norm_squared()).sum::<f64>();
        if variance < MIN_NORMAL_VARIANCE * n {
            return None;
        }
        radius_m = side.iter().map(|s| (s.0 - mean_p).dot(&(s.1 - mean_m))).sum::<f64>() / variance;
        centre = mean_p - mean_m * radius_m;
        if pass == 2 {
            break;
        }
        let residual = |s: &(Vector2<f64>, Vector2<f64>, f64)| (s.0 - centre - s.1 * radius_m).norm();
        let mut residuals: Vec<f64> = side.iter().map(residual).collect();
        residuals.sort_by(f64::total_cmp);
        let cut = (3.0 * residuals[residuals.len() / 2]).max(0.003);
        side.retain(|s| residual(s) <= cut);
        if side.len() < MIN_SAMPLES {
            return None;
        }
    }
    if !(0.002..0.14).contains(&radius_m) {
        return None;
    }
    let heights = samples.iter().map(|s| s.point.coords.dot(&axis));
    let (mut from_m, to_m) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
    if axis.z > 0.9 && from_m - table_height_m < ON_TABLE_M {
        from_m = table_height_m.min(from_m);
    }
    let centre_in_base = stretch * centre;
    let origin = Point::from(e1 * centre_in_base.x + e2 * centre_in_base.y);
    let radii_m = profile(samples, &origin, axis, &oval, from_m, to_m, radius_m);
    // A face of a box lies near some circle; its normals do not. They count as the offset that their error makes.
    let turned = |s: &(Vector2<f64>, Vector2<f64>, f64)| {
        let out = s.0 - centre;
        0.5 * radius_at(from_m, &radii_m, s.2) * (out.normalize() - s.1.normalize()).norm()
    };
    let turned_m2 = side.iter().map(|s| turned(s).powi(2)).sum::<f64>() / side.len() as f64;
    let shape = Shape::Revolution { origin, axis, oval, from_m, to_m, radii_m: radii_m.clone() };
    let rms_m = (rms(&shape, samples).powi(2) + turned_m2).sqrt();
    Some(Fit { shape, rms_m })
}

/// Mean distance from the axis at each step; steps that were not seen take their neighbours' value.
fn profile(
    samples: &[Sample],
    origin: &Point,
    axis: Unit<Vector>,
    oval: &Oval,
    from_m: f64,
    to_m: f64,
    radius_m: f64,
) -> Vec<f64> {
    let n_steps = (((to_m - from_m) / PROFILE_STEP_M).ceil() as usize).max(1);
    let mut sums = vec![(0.0, 0.0); n_steps];
    for sample in samples {
        let offset = sample.point - origin;
        let along = offset.dot(&axis);
        let across = offset - axis.into_inner() * along;
        // The inner wall of a vessel and its end faces say nothing about the outside.
        if sample.normal.dot(&across) < 0.3 * across.norm() {
            continue;
        }
        let step = (((along - from_m) / PROFILE_STEP_M) as usize).min(n_steps - 1);
        sums[step].0 += if oval.aspect > 1.0 { oval.radius_through_m(&offset.xy()) } else { across.norm() };
        sums[step].1 += 1.0;
    }
    let seen: Vec<(usize, f64)> = sums.iter().enumerate().filter(|(_, s)| s.1 > 0.0).map(|(i, s)| (i, s.0 / s.1)).collect();
    (0..n_steps)
        .map(|i| {
            let after = seen.partition_point(|s| s.0 < i);
            match (after.checked_sub(1).map(|b| seen[b]), seen.get(after)) {
                (_, Some(&(j, r))) if j == i => r,
                (Some((a, ra)), Some(&(b, rb))) => ra + (rb - ra) * (i - a) as f64 / (b - a) as f64,
                (Some((_, r)), None) | (None, Some(&(_, r))) => r,
                (None, None) => radius_m,
            }
        })
        .collect()
}

/// An upright box. Its depth is what the top face shows, or, when one side alone was seen, its width.
fn fit_cuboid(samples: &[Sample], table_height_m: f64) -> Fit {
    // Normals of a box repeat every quarter turn, so four times their angle has one direction.
    let turned: Vector2<f64> = samples
        .iter()
        .filter(|s| s.normal.xy().norm() > 0.7)
        .map(|s| {
            let angle = 4.0 * s.normal.y.atan2(s.normal.x);
            Vector2::new(angle.cos(), angle.sin())
        })
        .sum();
    let yaw = if turned.norm() > 5.0 { turned.y.atan2(turned.x) / 4.0 } else { longest_horizontal(samples) };
    let turn = UnitQuaternion::from_axis_angle(&Vector::z_axis(), yaw);
    let local: Vec<Sample> = samples
        .iter()
        .map(|s| Sample { point: turn.inverse_transform_point(&s.point), normal: turn.inverse_transform_vector(&s.normal) })
        .collect();
    let extent = |axis: usize| {
        let mut values: Vec<f64> = local.iter().map(|s| s.point[axis]).collect();
        values.sort_by(f64::total_cmp);
        let cut = values.len() / 100;
        (values[cut], values[values.len() - 1 - cut])
    };
    let mut ranges = [extent(0), extent(1), extent(2)];
    let share = |test: &dyn Fn(&Sample) -> bool| local.iter().filter(|s| test(s)).count() as f64 / local.len() as f64;
    if share(&|s| s.normal.z.abs() > 0.8) < 0.05 {
        for axis in 0..2 {
            let (plus, minus) = (share(&|s| s.normal[axis] > 0.8), share(&|s| s.normal[axis] < -0.8));
            let other = ranges[1 - axis].1 - ranges[1 - axis].0;
            let missing = other.min(0.06) - (ranges[axis].1 - ranges[axis].0);
            if missing > 0.0 && plus > 0.5 {
                ranges[axis].0 -= missing;
            } else if missing > 0.0 && minus > 0.5 {
                ranges[axis].1 += missing;
            }
        }
    }
    if ranges[2].0 - table_height_m < ON_TABLE_M {
        ranges[2].0 = table_height_m.min(ranges[2].0);
    }
    let centre = Point::from(Vector::from(ranges.map(|(low, high)| 0.5 * (low + high))));
    let half_m = Vector::from(ranges.map(|(low, high)| (0.5 * (high - low)).max(0.001)));
    let base_from_box = Pose::from_parts((turn * centre).coords.into(), turn);
    let shape = Shape::Cuboid { base_from_box, half_m };
    let rms_m = rms(&shape, samples);
    Fit { shape, rms_m }
}

fn longest_horizontal(samples: &[Sample]) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().map(|s| s.point.coords).sum::<Vector>() / n;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for s in samples {
        let d = s.point.coords - mean;
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
    }
    0.5 * (2.0 * xy).atan2(xx - yy)
}

fn rms(shape: &Shape, samples: &[Sample]) -> f64 {
    (samples.iter().map(|s| shape.distance(&s.point).powi(2)).sum::<f64>() / samples.len() as f64).sqrt()
}

/// Linear between the middles of the steps, constant beyond the ends.
fn radius_at(from_m: f64, radii_m: &[f64], along_m: f64) -> f64 {
    let last = radii_m.len() - 1;
    let step = ((along_m - from_m) / PROFILE_STEP_M - 0.5).clamp(0.0, last as f64);
    let low = step as usize;
    let share = step - low as f64;
    radii_m[low] * (1.0 - share) + radii_m[(low + 1).min(last)] * share
}

/// Signed distance to an edge from the distances to the two faces that meet there.
fn outside_corner(a: f64, b: f64) -> f64 {
    if a > 0.0 && b > 0.0 { a.hypot(b) } else { a.max(b) }
}
