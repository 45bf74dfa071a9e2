//! The measures of one cluster: upright box, axis of revolution, hollow or not, handle, head.

use crate::round::{Revolution, fit_oval, fit_revolution, thinned};
use crate::table::convex_hull;
use nalgebra::{Matrix4, Point3, Vector4};
use sfg_geometry::Oval;
use sfg_types::ShapeClass;

/// A fit is believed when this share of the points agrees, seen over this share of the directions.
const MIN_ROUND_SUPPORT: f32 = 0.58;
const MIN_ROUND_COVERAGE: f32 = 0.42;
/// The top of a bottle is narrower than its body by at least this factor.
const MAX_NARROW_RATIO: f32 = 0.75;
/// One form more fits noise a little better; an oval thing is explained much better by an oval.
const OVAL_GAIN: f32 = 0.85;
/// Points this far outside the body belong to a handle: four sigmas of the depth noise.
pub(crate) const HANDLE_GAP_M: f32 = 0.010;
/// The band below the top that counts as the rim.
pub(crate) const RIM_M: f32 = 0.012;
/// Lower things show their whole outline to cameras above, and hardly any side.
const LOW_M: f32 = 0.040;
const N_SECTIONS: usize = 24;

/// An upright rectangle seen from above.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rectangle {
    pub(crate) centre: [f32; 2],
    /// Long and short side.
    pub(crate) sides_m: [f32; 2],
    /// Direction of the long side, [-pi/2, pi/2).
    pub(crate) yaw_rad: f32,
}

impl Rectangle {
    /// Coordinates of (x, y) along the long and the short side, from the centre.
    pub(crate) fn local(&self, x: f32, y: f32) -> [f32; 2] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
        [dx * cos + dy * sin, dy * cos - dx * sin]
    }
}

/// Widths along a lying thing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lengthwise {
    /// Place of the step in width along the long side, from the centre, metres.
    pub(crate) split_m: f32,
    /// True when the wide end lies at the positive end of the long side.
    pub(crate) wide_at_end: bool,
    /// Mean width of the wide section.
    pub(crate) wide_m: f32,
    /// Mean width of the thin section.
    pub(crate) thin_m: f32,
    /// Length of the wide section over the whole length.
    pub(crate) wide_share: f32,
}

/// What the points of one cluster say about its form.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    pub(crate) class: ShapeClass,
    /// The upright box from above. Round things: centred on the axis.
    pub(crate) rectangle: Rectangle,
    /// Height of the supporting plane below it and of its top, base frame.
    pub(crate) bottom_z_m: f32,
    pub(crate) top_z_m: f32,
    /// Present for round things only.
    pub(crate) round: Option<Revolution>,
    /// The inside is visible below the rim.
    pub(crate) hollow: bool,
    /// How far a handle reaches beyond the round body; 0 = none.
    pub(crate) handle_reach_m: f32,
    /// Present for lying long things only.
    pub(crate) lengthwise: Option<Lengthwise>,
}

impl Shape {
    /// Height above the supporting plane.
    pub(crate) fn height_m(&self) -> f32 {
        self.top_z_m - self.bottom_z_m
    }

    /// Radius of the top over the largest radius; 1 for things that are not round.
    pub(crate) fn top_ratio(&self) -> f32 {
        self.round.as_ref().map_or(1.0, |round| top_radius(round, self.top_z_m) / round.max_radius_m().max(1e-3))
    }
}

/// The form of a cluster that stands on a plane at `bottom_z_m`; `None` for fewer than ten points.
///
/// Points about the height of the table show thin parts of lying things, but mix with the table at the foot of standing
/// ones; so they count for lying things only.
pub(crate) fn measure(all_points: &[Point3<f32>], bottom_z_m: f32) -> Option<Shape> {
    if all_points.len() < 10 {
        return None;
    }
    let raised: Vec<Point3<f32>> = all_points.iter().filter(|p| is_raised(p, bottom_z_m)).copied().collect();
    let points: &[Point3<f32>] = if raised.len() < 10 { all_points } else { &raised };
    let top_z_m = top(points).max(bottom_z_m + 0.005);
    let height = top_z_m - bottom_z_m;
    let rectangle = min_area_rectangle(points);
    let ball = ball(points, bottom_z_m, height);
    let round = ball.clone().or_else(|| {
        let round = revolution(points, bottom_z_m, top_z_m, &rectangle);
        let oval = oval(points, bottom_z_m, top_z_m, &rectangle);
        match (round, oval) {
            (Some(round), Some(oval)) if mean_miss_m(points, &oval) < OVAL_GAIN * mean_miss_m(points, &round) => Some(oval),
            (round, oval) => round.or(oval),
        }
    });
    let Some(round) = round else {
        let standing = angular(points, rectangle, bottom_z_m, top_z_m);
        let lies = standing.class != ShapeClass::Box;
        return Some(if lies { angular(all_points, min_area_rectangle(all_points), bottom_z_m, top_z_m) } else { standing });
    };
    let hollow = ball.is_none() && is_hollow(points, &round, top_z_m);
    let radius = if hollow { outer_radius(points, &round) } else { round.max_radius_m() };
    let (handle_reach_m, handle_yaw) = if ball.is_some() { (0.0, 0.0) } else { handle(points, &round) };
    let is_oval = round.oval.aspect > 1.0;
    let [long, short] = round.oval.half_axes_m(f64::from(2.0 * radius)).map(|side| side as f32);
    let rectangle = Rectangle {
        centre: round.centre,
        sides_m: [long + handle_reach_m, short],
        yaw_rad: match () {
            () if handle_reach_m > 0.0 => half_turn(handle_yaw),
            () if is_oval => round.oval.yaw_rad() as f32,
            () => 0.0,
        },
    };
    let class = match () {
        () if ball.is_some() => ShapeClass::Blob,
        () if is_oval => ShapeClass::UprightOval,
        () if height > 2.0 * radius => ShapeClass::UprightCylinder,
        () => ShapeClass::WideRound,
    };
    Some(Shape { class, rectangle, bottom_z_m, top_z_m, round: Some(round), hollow, handle_reach_m, lengthwise: None })
}

/// True above the height up to which the table's noise reaches.
pub(crate) fn is_raised(point: &Point3<f32>, bottom_z_m: f32) -> bool {
    point.z > bottom_z_m + crate::clustering::MIN_HEIGHT_M
}

/// A thing without a vertical axis.
fn angular(points: &[Point3<f32>], rectangle: Rectangle, bottom_z_m: f32, top_z_m: f32) -> Shape {
    let height = top_z_m - bottom_z_m;
    let [long, short] = rectangle.sides_m;
    let fill = filled_share(points, &rectangle);
    let lies = height < 0.6 * long && long > 0.09;
    let class = match () {
        () if lies && (long > 2.3 * short || (long > 1.6 * short && fill < 0.6)) => ShapeClass::Elongated,
        () if lies && fill < 0.45 => ShapeClass::Elongated,
        () if fill > 0.78 => ShapeClass::Box,
        () => ShapeClass::Blob,
    };
    let lengthwise = (lies && class != ShapeClass::Blob).then(|| lengthwise(points, &rectangle));
    Shape { class, rectangle, bottom_z_m, top_z_m, round: None, hollow: false, handle_reach_m: 0.0, lengthwise }
}

/// Height of the top without the noise above it.
fn top(points: &[Point3<f32>]) -> f32 {
    const BIN_M: f32 = 0.002;
    let mut heights: Vec<f32> = points.iter().map(|p| p.z).collect();
    // The sixth highest: single flying pixels do not count.
    let rank = heights.len() - 1 - 5.min(heights.len() / 4);
    let highest = *heights.select_nth_unstable_by(rank, f32::total_cmp).1;
    let mut window = [0_usize; 9];
    let mut n_window = 0;
    for z in &heights {
        let below = highest - z;
        if (0.0..0.018).contains(&below) {
            window[((below / BIN_M) as usize).min(8)] += 1;
            n_window += 1;
        }
    }
    // A flat top is a peak some sigmas below the highest point. A rim has no peak.
    let peak = (0..9).max_by_key(|&i| (window[i], 9 - i)).unwrap_or(0);
    if window[peak] * 6 > n_window && peak <= 6 && n_window > 200 {
        highest - (peak as f32 + 0.5) * BIN_M
    } else {
        highest - 0.001
    }
}

/// The smallest upright rectangle; sides are cut at the 1st and 99th percentile so that noise does not widen them.
fn min_area_rectangle(points: &[Point3<f32>]) -> Rectangle {
    let sample = thinned(points, 4000);
    let hull = convex_hull(sample.iter().map(|p| [p.x, p.y]).collect());
    let extents = |yaw: f32| {
        let (sin, cos) = yaw.sin_cos();
        let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
        for p in &hull {
            let local = [p[0] * cos + p[1] * sin, p[1] * cos - p[0] * sin];
            for axis in 0..2 {
                low[axis] = low[axis].min(local[axis]);
                high[axis] = high[axis].max(local[axis]);
            }
        }
        (high[0] - low[0]) * (high[1] - low[1])
    };
    // One-degree steps: finer than the noise of the outline allows anyway.
    let best = (0..90).map(|deg| (deg as f32).to_radians()).min_by(|a, b| extents(*a).total_cmp(&extents(*b))).unwrap_or(0.0);
    let (sin, cos) = best.sin_cos();
    let trimmed = |axis: usize| {
        let mut values: Vec<f32> =
            sample.iter().map(|p| if axis == 0 { p.x * cos + p.y * sin } else { p.y * cos - p.x * sin }).collect();
        values.sort_by(f32::total_cmp);
        let cut = values.len() / 100;
        (values[cut], values[values.len() - 1 - cut])
    };
    let ((u0, u1), (v0, v1)) = (trimmed(0), trimmed(1));
    let (u, v) = ((u0 + u1) / 2.0, (v0 + v1) / 2.0);
    let centre = [u * cos - v * sin, u * sin + v * cos];
    let (du, dv) = (u1 - u0, v1 - v0);
    if du >= dv {
        Rectangle { centre, sides_m: [du, dv], yaw_rad: half_turn(best) }
    } else {
        Rectangle { centre, sides_m: [dv, du], yaw_rad: half_turn(best + std::f32::consts::FRAC_PI_2) }
    }
}

/// The same direction of a line, in [-pi/2, pi/2).
fn half_turn(angle_rad: f32) -> f32 {
    let pi = std::f32::consts::PI;
    (angle_rad + pi / 2.0).rem_euclid(pi) - pi / 2.0
}

/// Share of the rectangle's 6 mm cells that hold points.
fn filled_share(points: &[Point3<f32>], rectangle: &Rectangle) -> f32 {
    const CELL_M: f32 = 0.006;
    let n = rectangle.sides_m.map(|side| ((side / CELL_M) as usize).max(1));
    let mut used = vec![false; n[0] * n[1]];
    for p in points {
        let local = rectangle.local(p.x, p.y);
        let cell = [0, 1].map(|a| ((local[a] / rectangle.sides_m[a].max(1e-4) + 0.5) * n[a] as f32).floor());
        if (0.0..n[0] as f32).contains(&cell[0]) && (0.0..n[1] as f32).contains(&cell[1]) {
            used[cell[0] as usize * n[1] + cell[1] as usize] = true;
        }
    }
    used.iter().filter(|&&u| u).count() as f32 / used.len() as f32
}

/// A ball resting on the plane: least-squares sphere, believed when it fits within noise and touches the plane.
fn ball(points: &[Point3<f32>], bottom_z_m: f32, height: f32) -> Option<Revolution> {
    let sample = thinned(points, 1500);
    let mean = sample.iter().fold(nalgebra::Vector3::zeros(), |sum, p| sum + p.coords) / sample.len() as f32;
    let (mut normal, mut right) = (Matrix4::<f32>::zeros(), Vector4::<f32>::zeros());
    for p in &sample {
        let q = p.coords - mean;
        let row = Vector4::new(2.0 * q.x, 2.0 * q.y, 2.0 * q.z, 1.0);
        normal += row * row.transpose();
        right += row * q.norm_squared();
    }
    let solution = normal.try_inverse()? * right;
    let offset = solution.xyz();
    let radius = (solution.w + offset.norm_squared()).max(0.0).sqrt();
    let centre = mean + offset;
    let mean_square = sample.iter().map(|p| ((p.coords - centre).norm() - radius).powi(2)).sum::<f32>() / sample.len() as f32;
    let touches = (centre.z - radius - bottom_z_m).abs() < 0.25 * radius;
    let fits = mean_square.sqrt() < 0.0032 && (0.015..0.14).contains(&radius) && (height / (2.0 * radius) - 1.0).abs() < 0.2;
    if !(touches && fits) {
        return None;
    }
    let n_slices = (2.0 * radius / crate::round::SLICE_M) as usize;
    let slices = (0..=n_slices)
        .map(|i| {
            let z = bottom_z_m + (i as f32 + 0.5) * crate::round::SLICE_M;
            let radius_m = (radius * radius - (z - centre.z).powi(2)).max(1e-6).sqrt();
            crate::round::Slice { z_m: z, radius_m }
        })
        .collect();
    Some(Revolution { centre: [centre.x, centre.y], oval: Oval::ROUND, slices, support: 1.0, coverage: 0.5 })
}

/// The axis of the cluster when it is round rather than angular.
fn revolution(points: &[Point3<f32>], bottom_z_m: f32, top_z_m: f32, rectangle: &Rectangle) -> Option<Revolution> {
    if let Some(disk) = disk(points, bottom_z_m, top_z_m) {
        return Some(disk);
    }
    let fit = fit_revolution(points, bottom_z_m)?;
    let (on_outline, on_edges) = sides_on(points, &fit, rectangle, top_z_m);
    (is_round_enough(&fit) && on_outline > on_edges).then_some(fit)
}

/// The axis of a standing thing with an oval outline: flat bottles.
fn oval(points: &[Point3<f32>], bottom_z_m: f32, top_z_m: f32, rectangle: &Rectangle) -> Option<Revolution> {
    if top_z_m - bottom_z_m < rectangle.sides_m[0] {
        return None;
    }
    let fit = fit_oval(points, bottom_z_m, top_z_m)?;
    let (on_outline, on_edges) = sides_on(points, &fit, rectangle, top_z_m);
    // Flat sides lie on a rectangle too, but no box is narrower at its top.
    let narrows = top_radius(&fit, top_z_m) < MAX_NARROW_RATIO * fit.max_radius_m();
    (is_round_enough(&fit) && (narrows || on_outline > on_edges)).then_some(fit)
}

/// Mean distance of the points from the outline at their height; what lies farther than a centimetre counts as that.
fn mean_miss_m(points: &[Point3<f32>], fit: &Revolution) -> f32 {
    let sum: f32 = points.iter().map(|p| (fit.distance(p.x, p.y) - fit.radius_at(p.z)).abs().min(0.010)).sum();
    sum / points.len().max(1) as f32
}

fn is_round_enough(fit: &Revolution) -> bool {
    fit.support > MIN_ROUND_SUPPORT && fit.coverage > MIN_ROUND_COVERAGE && !fit.slices.is_empty()
}

/// Shares of the side's points on the outline of a fit and on the rectangle: the sides of a box lie on its rectangle. A flat top lies on
/// neither and says nothing.
fn sides_on(points: &[Point3<f32>], fit: &Revolution, rectangle: &Rectangle, top_z_m: f32) -> (f32, f32) {
    let sides: Vec<_> = points.iter().filter(|p| p.z < top_z_m - 0.010).collect();
    let share = |n: usize| n as f32 / sides.len().max(1) as f32;
    let on_outline = sides.iter().filter(|p| (fit.distance(p.x, p.y) - fit.radius_at(p.z)).abs() < 0.005).count();
    let on_edges = sides.iter().filter(|p| edge_distance(rectangle, p) < 0.005).count();
    (share(on_outline), share(on_edges))
}

fn edge_distance(rectangle: &Rectangle, point: &Point3<f32>) -> f32 {
    let [u, v] = rectangle.local(point.x, point.y);
    let (du, dv) = (rectangle.sides_m[0] / 2.0 - u.abs(), rectangle.sides_m[1] / 2.0 - v.abs());
    if du >= 0.0 && dv >= 0.0 { du.min(dv) } else { du.min(0.0).hypot(dv.min(0.0)) }
}

/// A low round thing (plate, saucer, lid): its outline from above is a circle.
fn disk(points: &[Point3<f32>], bottom_z_m: f32, top_z_m: f32) -> Option<Revolution> {
    if top_z_m - bottom_z_m > LOW_M {
        return None;
    }
    let sample = thinned(points, 4000);
    let hull = convex_hull(sample.iter().map(|p| [p.x, p.y]).collect());
    let n = hull.len() as f32;
    if hull.len() < 8 {
        return None;
    }
    let (mx, my) = hull.iter().fold((0.0, 0.0), |(x, y), p| (x + p[0] / n, y + p[1] / n));
    let (mut normal, mut right) = (nalgebra::Matrix3::<f32>::zeros(), nalgebra::Vector3::<f32>::zeros());
    for p in &hull {
        let (x, y) = (p[0] - mx, p[1] - my);
        let row = nalgebra::Vector3::new(2.0 * x, 2.0 * y, 1.0);
        normal += row * row.transpose();
        right += row * (x * x + y * y);
    }
    let solution = normal.try_inverse()? * right;
    let radius = (solution.z + solution.x.powi(2) + solution.y.powi(2)).max(0.0).sqrt();
    let centre = [mx + solution.x, my + solution.y];
    let worst = hull.iter().map(|p| ((p[0] - centre[0]).hypot(p[1] - centre[1]) - radius).abs()).fold(0.0, f32::max);
    // The few corners of a hammer's outline may lie on a circle as well, but do not fill it.
    let area = 0.5
        * (0..hull.len())
            .map(|i| {
                let (a, b) = (hull[i], hull[(i + 1) % hull.len()]);
                a[0] * b[1] - b[0] * a[1]
            })
            .sum::<f32>();
    // A square's corners miss its circle by a fifth of the radius.
    if worst > 0.004 + 0.06 * radius || radius < 0.02 || area < 0.88 * std::f32::consts::PI * radius * radius {
        return None;
    }
    // The hull of noisy points lies about one sigma outside.
    let radius_m = (radius - 0.0015).max(0.01);
    let slice = crate::round::Slice { z_m: (bottom_z_m + top_z_m) / 2.0, radius_m };
    Some(Revolution { centre, oval: Oval::ROUND, slices: vec![slice], support: 1.0, coverage: 1.0 })
}

/// Largest radius of an open vessel. Its slices mix the outer and the inner face of the wall, so the mean lies within the wall.
fn outer_radius(points: &[Point3<f32>], round: &Revolution) -> f32 {
    let Some(widest) = round.slices.iter().max_by(|a, b| a.radius_m.total_cmp(&b.radius_m)) else { return 0.0 };
    let mut distances: Vec<f32> = points
        .iter()
        .filter(|p| (p.z - widest.z_m).abs() < crate::round::SLICE_M / 2.0)
        .map(|p| round.distance(p.x, p.y))
        .filter(|distance| (distance - widest.radius_m).abs() < 0.006)
        .collect();
    distances.sort_by(f32::total_cmp);
    distances.get(distances.len() * 3 / 4).copied().unwrap_or(widest.radius_m)
}

/// Reach and direction of whatever sticks out of the round body on one side; 0 when nothing does.
fn handle(points: &[Point3<f32>], round: &Revolution) -> (f32, f32) {
    let widest = round.max_radius_m();
    let mut reaches = Vec::new();
    let (mut x, mut y) = (0.0, 0.0);
    for p in points {
        let distance = round.distance(p.x, p.y);
        let gap = distance - round.radius_at(p.z);
        // Beyond the widest part as well: a shoulder between two slices is no handle.
        if gap > HANDLE_GAP_M && distance > widest + HANDLE_GAP_M * 0.6 {
            reaches.push(distance - widest);
            x += (p.x - round.centre[0]) / distance;
            y += (p.y - round.centre[1]) / distance;
        }
    }
    let n = reaches.len();
    // One handle points in one direction; noise all around does not.
    if n < 25 || (n as f32) < 0.008 * points.len() as f32 || x.hypot(y) < 0.6 * n as f32 {
        return (0.0, 0.0);
    }
    reaches.sort_by(f32::total_cmp);
    let reach = reaches[n - 1 - n / 150];
    if reach < 0.012 { (0.0, 0.0) } else { (reach, y.atan2(x)) }
}

fn top_radius(round: &Revolution, top_z_m: f32) -> f32 {
    round.radius_at(top_z_m - RIM_M / 2.0)
}

/// True when hardly any of the disk inside the rim lies at the height of the rim.
fn is_hollow(points: &[Point3<f32>], round: &Revolution, top_z_m: f32) -> bool {
    const CELL_M: f32 = 0.006;
    let inner = 0.7 * top_radius(round, top_z_m);
    // Narrower openings cannot be told from caps at this resolution.
    if inner < 0.014 {
        return false;
    }
    let n = (2.0 * inner / CELL_M) as usize + 1;
    let mut at_rim = vec![false; n * n];
    for p in points {
        if p.z > top_z_m - RIM_M && round.distance(p.x, p.y) < inner {
            let cell = |value: f32, centre: f32| ((value - centre + inner) / CELL_M) as usize;
            let (i, j) = (cell(p.x, round.centre[0]).min(n - 1), cell(p.y, round.centre[1]).min(n - 1));
            at_rim[i * n + j] = true;
        }
    }
    let n_cells_in_disk = std::f32::consts::PI * inner * inner / (CELL_M * CELL_M);
    (at_rim.iter().filter(|&&cell| cell).count() as f32) < 0.35 * n_cells_in_disk
}

/// Where a lying thing changes its width: the split into two sections that explains most of the variance (Otsu).
fn lengthwise(points: &[Point3<f32>], rectangle: &Rectangle) -> Lengthwise {
    let length = rectangle.sides_m[0];
    let mut across: Vec<Vec<f32>> = vec![Vec::new(); N_SECTIONS];
    for p in points {
        let [u, v] = rectangle.local(p.x, p.y);
        let section = ((u / length + 0.5) * N_SECTIONS as f32).floor();
        if (0.0..N_SECTIONS as f32).contains(&section) {
            across[section as usize].push(v);
        }
    }
    let widths: Vec<f32> = across
        .iter_mut()
        .map(|values| {
            values.sort_by(f32::total_cmp);
            let cut = values.len() / 25;
            if values.len() < 4 { 0.0 } else { values[values.len() - 1 - cut] - values[cut] }
        })
        .collect();
    let mean = |range: &[f32]| range.iter().sum::<f32>() / range.len() as f32;
    let contrast = |at: usize| {
        let (a, b) = widths.split_at(at);
        (a.len() * b.len()) as f32 * (mean(a) - mean(b)).powi(2)
    };
    // The outermost section is cut obliquely by the outline, so it is no section of its own.
    let at = (2..N_SECTIONS - 1).max_by(|a, b| contrast(*a).total_cmp(&contrast(*b))).unwrap_or(N_SECTIONS / 2);
    let (first, last) = (mean(&widths[..at]), mean(&widths[at..]));
    let wide_at_end = last > first;
    let share = at as f32 / N_SECTIONS as f32;
    Lengthwise {
        split_m: (share - 0.5) * length,
        wide_at_end,
        wide_m: first.max(last),
        thin_m: first.min(last),
        wide_share: if wide_at_end { 1.0 - share } else { share },
    }
}
