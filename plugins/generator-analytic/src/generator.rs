//! The plugin: one request in, ranked candidates out.

use crate::closing::{ClosingPath, Surroundings};
use crate::field::Field;
use crate::hand::{Ball, Hand};
use crate::ranking::{self, Scored, Wanted};
use crate::sampling::{self, PalmRule, Place, Proposal};
use crate::settings::{AnalyticSettings, PLUGIN_NAME};
use crate::shape::{self, Fit, Sample};
use crate::surface;
use crate::wrench::{Contact, Load, MarginBound, wrench_margin};
use sfg_plugin::{PluginContext, PluginError, PoseGenerator, PoseRequest};
use sfg_types::{GraspClass, GraspType, HandProfile, HandSide, Opposition, PalmPoseCandidate, Point, SynergyCoordinates, Vector};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Surface this close to the table is taken for the table, metres.
const TABLE_MARGIN_M: f64 = 0.006;
/// Surface points this far from a fitted shape belong to something else, metres.
const EXPLAINED_M: f64 = 0.005;
/// A second shape must be this good, metres rms, or its points stay loose.
const REST_RMS_M: f64 = 0.005;
/// Gap of the open hand to the table, metres.
const TABLE_GAP_M: f64 = 0.01;
/// The lowest palm keeps this much more, metres.
const ROUNDING_M: f64 = 1e-6;
/// Gap of the open hand to the object, metres; the palm may be nearer by its own clearance.
const OPEN_GAP_M: f64 = 0.001;
/// How far back along the approach the open hand must be free as well, metres.
const BACK_OFF_M: [f64; 2] = [0.04, 0.09];
/// Where a power grasp takes a thing along the fingers, palm x: ahead of the thumb's root, metres.
const POWER_CENTRES_M: [f64; 3] = [0.02, 0.03, 0.04];
/// How deep between the pads a thing is taken, metres.
const PAD_DEPTHS_M: [f64; 3] = [0.008, 0.018, 0.03];
/// Lead of thumb and index finger in wraps, along the second synergy: one thumb opposes four fingers. In 700 simulated closings about a
/// bottle with the thumb down 16 to 32 % held it within 0.2 rad of where it stood with a lead of 0, 60 to 85 % with 0.1 or 0.2.
const THUMB_LEAD: f64 = 0.15;
/// Ways of grasping that are tried at every place.
const N_STYLES: usize = 16;
/// Closings of one group whose wrench margin is computed exactly: those at the probes.
const N_EXACT_PER_GROUP: usize = 3;
/// Configurations of a closing path.
const N_LEVELS: usize = 33;
/// The palm bears the object that the fingers pull in when its gap is at most this much more than intended, metres.
const PALM_REACH_M: f64 = 0.006;

/// Proposes palm poses from the TSDF alone; see the crate's documentation for the steps.
#[derive(Debug)]
pub struct AnalyticGenerator {
    settings: AnalyticSettings,
    robots_dir: PathBuf,
    hands: Vec<Hand>,
    bound: MarginBound,
}

impl AnalyticGenerator {
    /// A generator for the hand of `context`; the hand of the other side is read when first asked for.
    ///
    /// # Errors
    /// [`PluginError::BadParameter`] for a wrong parameter, [`PluginError::Failed`] when the hand's files are broken.
    pub fn new(context: &PluginContext<'_>) -> Result<Self, PluginError> {
        let settings = AnalyticSettings::from_params(context.params)?;
        let mut generator = Self {
            settings,
            robots_dir: context.scenarios_dir.join("robots"),
            hands: Vec::new(),
            bound: MarginBound::new(context.seed),
        };
        generator.hand_idx(context.hand, context.hand_side)?;
        Ok(generator)
    }

    fn hand_idx(&mut self, profile: &HandProfile, side: HandSide) -> Result<usize, PluginError> {
        if let Some(idx) = self.hands.iter().position(|hand| hand.side == side) {
            return Ok(idx);
        }
        let hand = Hand::load(profile, side, &self.robots_dir).map_err(|error| failed(error.to_string()))?;
        self.hands.push(hand);
        Ok(self.hands.len() - 1)
    }
}

impl PoseGenerator for AnalyticGenerator {
    fn generate(&mut self, request: &PoseRequest<'_>, out: &mut [PalmPoseCandidate]) -> Result<usize, PluginError> {
        let hand_idx = self.hand_idx(request.hand, request.hand_side)?;
        let type_profile = request
            .hand
            .grasp_types
            .get(&request.grasp_type)
            .ok_or_else(|| failed(format!("hand {:?} has no grasp type {}", request.hand.name, request.grasp_type)))?;
        check_grid(request)?;
        let target = target(type_profile.c_tar, request.grasp_type);
        let n_wanted = out.len().min(self.settings.n_candidates);
        let Some(object) = Completed::new(request) else { return Ok(0) };
        let job = Job {
            settings: &self.settings,
            request,
            hand: &self.hands[hand_idx],
            object: &object,
            bound: &self.bound,
            path: closing_path(request.hand, target, request.grasp_type),
            load: Load {
                centre_of_mass_in_base: object.field.centroid().unwrap_or(request.key_point.point_in_base),
                mass_kg: self.settings.mass_kg,
                friction: self.settings.friction,
            },
        };
        let best = job.best(n_wanted);
        for (slot, scored) in out.iter_mut().zip(&best) {
            *slot = PalmPoseCandidate {
                base_from_palm: scored.base_from_palm,
                hand_side: request.hand_side,
                stability: scored.stability(),
                synergy: target,
                terms: scored.report(),
            };
        }
        Ok(best.len())
    }
}

/// The object as far as it was seen, completed by fits.
struct Completed {
    part: Fit,
    field: Field,
}

impl Completed {
    /// `None` when the part shows too little surface.
    fn new(request: &PoseRequest<'_>) -> Option<Self> {
        let table_m = request.table_height_m;
        let all = surface::samples(request.tsdf, request.affordance_region, table_m, TABLE_MARGIN_M);
        let part: Vec<Sample> = all.iter().filter(|s| s.is_on_part).map(|s| s.sample).collect();
        let part = shape::fit_near(&part, &request.key_point.point_in_base, table_m)?;
        let everything: Vec<Sample> = all.iter().map(|s| s.sample).collect();
        let mut loose = shape::unexplained(&part.shape, &everything, EXPLAINED_M);
        let mut shapes = vec![part.shape.clone()];
        if let Some(rest) = shape::fit(&loose, table_m).filter(|fit| fit.rms_m < REST_RMS_M) {
            loose = shape::unexplained(&rest.shape, &loose, EXPLAINED_M);
            shapes.push(rest.shape);
        }
        let field = Field::new(request.tsdf, &shapes, &loose);
        Some(Self { part, field })
    }
}

/// One request with all that is computed once for it.
struct Job<'a> {
    settings: &'a AnalyticSettings,
    request: &'a PoseRequest<'a>,
    hand: &'a Hand,
    object: &'a Completed,
    bound: &'a MarginBound,
    path: ClosingPath,
    load: Load,
}

impl Job<'_> {
    /// The best candidates of the first rule that has any.
    fn best(&self, n_wanted: usize) -> Vec<Scored> {
        let open = self.open_hand();
        let found = self.palm_rules().iter().map(|rule| self.best_of(rule, &open, n_wanted)).find(|best| !best.is_empty());
        found.unwrap_or_default()
    }

    fn best_of(&self, rule: &PalmRule, open: &[Ball], n_wanted: usize) -> Vec<Scored> {
        let place = Place {
            field: &self.object.field,
            key_point: self.request.key_point.point_in_base,
            table_height_m: self.request.table_height_m,
            lowest_palm_m: &|rotation| {
                let lowest_m = open.iter().map(|b| (rotation * b.centre).z - b.radius_m).fold(f64::INFINITY, f64::min);
                TABLE_GAP_M + ROUNDING_M - lowest_m
            },
        };
        let proposals = sampling::proposals(&self.object.part.shape, &place, rule, self.hand.side);
        // What holds a round thing at one place holds it at the others: styles are chosen at a few places first.
        let mut scored: Vec<Scored> =
            proposals.iter().filter(|p| p.is_probe).filter_map(|p| self.try_pose(p, rule, open)).collect();
        let mut probed = scored.clone();
        ranking::share_in_groups(&mut probed);
        let mut of_style: BTreeMap<usize, f64> = BTreeMap::new();
        for found in &probed {
            let best = of_style.entry(found.style).or_insert(0.0);
            *best = best.max(found.stability());
        }
        let mut styles: Vec<(usize, f64)> = of_style.into_iter().collect();
        styles.sort_by(|a, b| b.1.total_cmp(&a.1));
        styles.truncate(N_STYLES);
        let chosen = |p: &&Proposal| !p.is_probe && styles.iter().any(|(style, _)| *style == p.style);
        scored.extend(proposals.iter().filter(chosen).filter_map(|p| self.try_pose(p, rule, open)));
        ranking::share_in_groups(&mut scored);
        self.measure_groups(&mut scored);
        ranking::sort_best_first(&mut scored);
        let mut best: Vec<Scored> = ranking::diverse(&scored, n_wanted).into_iter().map(|i| scored[i].clone()).collect();
        for candidate in best.iter_mut().filter(|candidate| candidate.group.is_none()).take(self.settings.n_exact) {
            candidate.margin_weights = wrench_margin(&points(candidate), &self.load);
        }
        best.retain(Scored::may_hold);
        ranking::sort_best_first(&mut best);
        best
    }

    /// Replaces the bounds of margins by the mean of some exact ones of each group.
    fn measure_groups(&self, scored: &mut [Scored]) {
        for members in ranking::groups(scored) {
            let measured = &members[..members.len().min(N_EXACT_PER_GROUP)];
            let sum: f64 = measured.iter().map(|i| wrench_margin(&points(&scored[*i]), &self.load)).sum();
            for idx in &members {
                scored[*idx].margin_weights = sum / measured.len() as f64;
            }
        }
    }

    /// The closed hand at a pose; `None` when the open hand does not fit there or nothing is held.
    fn try_pose(&self, proposal: &Proposal, rule: &PalmRule, open: &[Ball]) -> Option<Scored> {
        let request = self.request;
        let around = Surroundings::new(&self.object.field, &proposal.base_from_palm, request.table_height_m);
        if !around.is_free(open, OPEN_GAP_M, TABLE_GAP_M) {
            return None;
        }
        for back_m in BACK_OFF_M {
            let back = proposal.base_from_palm * nalgebra::Translation3::new(0.0, 0.0, -back_m);
            if !Surroundings::new(&self.object.field, &back, request.table_height_m).is_free(open, OPEN_GAP_M, TABLE_GAP_M) {
                return None;
            }
        }
        let is_power = rule.opposition == Opposition::Palm;
        let palm_reach_m = is_power.then_some(self.settings.clearance_m + PALM_REACH_M + self.standoffs().0);
        let mut closed = around.close(self.hand, &self.path, palm_reach_m);
        if is_power {
            // A fit's rim is sharper than the thing: what hooks over it does not count.
            let shape = &self.object.part.shape;
            closed.contacts.retain(|c| shape.is_side(&c.contact.inward_normal));
        }
        if closed.contacts.len() < 2 {
            return None;
        }
        let wanted = Wanted {
            hand: self.hand,
            grasp_type: request.grasp_type,
            key_point: request.key_point.point_in_base,
            table_height_m: request.table_height_m,
            friction: self.settings.friction,
            axis: self.object.part.shape.axis(),
        };
        let radius_m = self.object.part.shape.radius_near_m(&proposal.facing);
        let terms = ranking::terms(&closed, &proposal.base_from_palm, &proposal.facing, radius_m, &wanted);
        let contacts: Vec<Contact> = closed.contacts.iter().map(|c| c.contact).collect();
        let margin_weights = self.bound.evaluate(&contacts, &self.load);
        let is_wrap = is_power && !rule.from_above;
        let scored = Scored {
            base_from_palm: proposal.base_from_palm,
            style: proposal.style,
            group: proposal.group,
            contacts: closed.contacts,
            margin_weights,
            is_wrap,
            terms,
        };
        scored.may_hold().then_some(scored)
    }

    fn standoffs(&self) -> (f64, f64) {
        let profile = &self.request.hand.grasp_types[&self.request.grasp_type];
        (profile.standoff_min_m, profile.standoff_max_m)
    }

    /// The type's own rule, and for power types a grip with the finger tips where the palm finds no room, as on a table.
    fn palm_rules(&self) -> Vec<PalmRule> {
        let grasp_type = self.request.grasp_type;
        let (min_m, max_m) = self.standoffs();
        let pads = self.pad_centre();
        // The pads must reach beyond the near surface, so a hand whose tips meet closer than the profile says comes closer.
        let with_pads = PalmRule {
            opposition: Opposition::Pad,
            from_above: true,
            standoffs_m: PAD_DEPTHS_M.iter().map(|depth| (pads.z - depth).clamp(0.01, max_m.max(0.06))).collect(),
            centres_m: vec![[pads.x, pads.y]],
        };
        if grasp_type.class() != GraspClass::Power {
            return vec![with_pads];
        }
        let first = min_m + self.settings.clearance_m;
        let with_palm = PalmRule {
            opposition: Opposition::Palm,
            from_above: grasp_type == GraspType::PowerSphere,
            standoffs_m: if max_m - first > 0.004 { vec![first, max_m] } else { vec![first] },
            centres_m: POWER_CENTRES_M.map(|x| [x, 0.0]).to_vec(),
        };
        vec![with_palm, with_pads]
    }

    /// Palm-frame point where the thumb's tip and the tips that oppose it come nearest to each other on the way to `c_tar`.
    fn pad_centre(&self) -> Point {
        let n_opposing = match self.request.grasp_type {
            GraspType::PalmarPinch | GraspType::Lateral => 1,
            GraspType::Tripod => 2,
            _ => 3,
        };
        let mut nearest = (f64::INFINITY, Point::origin());
        for hand_q in &self.path.hand_qs[..=N_LEVELS / 2] {
            let tips = self.hand.tips_at(hand_q);
            let thumb = self.hand.fingers.iter().position(|f| f.is_thumb).map_or(Point::origin(), |i| tips[i]);
            let mut others: Vec<Point> =
                tips.iter().zip(&self.hand.fingers).filter(|(_, f)| !f.is_thumb).map(|(tip, _)| *tip).collect();
            others.sort_by(|a, b| (a - thumb).norm().total_cmp(&(b - thumb).norm()));
            others.truncate(n_opposing);
            let mean = Point::from(others.iter().map(|p| p.coords).sum::<Vector>() / others.len().max(1) as f64);
            let gap_m = (mean - thumb).norm();
            if gap_m < nearest.0 {
                nearest = (gap_m, nalgebra::center(&mean, &thumb));
            }
        }
        nearest.1
    }

    /// The arriving hand with room for the arm's last link behind it.
    fn open_hand(&self) -> Vec<Ball> {
        let mut balls = self.hand.balls_at(&self.path.hand_qs[0]);
        let back_m = self.hand.palm_balls.iter().map(|b| b.centre.x).fold(0.0, f64::min);
        let radius_m = self.settings.wrist_radius_m;
        for behind in [0.5, 1.5] {
            balls.push(Ball { centre: Vector::new(back_m - behind * radius_m, 0.0, -0.015), radius_m });
        }
        // Large balls first: they find a collision soonest.
        balls.sort_by(|a, b| b.radius_m.total_cmp(&a.radius_m));
        balls
    }
}

fn points(scored: &Scored) -> Vec<Contact> {
    scored.contacts.iter().map(|c| c.contact).collect()
}

/// Where the hand closes to: `c_tar`, and in wraps beyond it along the second synergy.
fn target(c_tar: SynergyCoordinates, grasp_type: GraspType) -> SynergyCoordinates {
    let lead = if ranking::thumb_is_opposed(grasp_type) { THUMB_LEAD } else { 0.0 };
    SynergyCoordinates::new(c_tar.c1, c_tar.c2 + lead).clamped()
}

/// From the open hand to `c_tar`, then on: the tendon keeps pulling until the motors stall.
fn closing_path(profile: &HandProfile, c_tar: SynergyCoordinates, grasp_type: GraspType) -> ClosingPath {
    let end = match grasp_type.class() {
        GraspClass::Power => SynergyCoordinates::new(1.0, c_tar.c2),
        _ => SynergyCoordinates::new((c_tar.c1 + 0.25).min(1.0), c_tar.c2),
    };
    let half = (N_LEVELS - 1) / 2;
    let coordinates = (0..N_LEVELS).map(|i| {
        if i <= half {
            SynergyCoordinates::OPEN.lerp(c_tar, i as f64 / half as f64)
        } else {
            c_tar.lerp(end, (i - half) as f64 / half as f64)
        }
    });
    ClosingPath { hand_qs: coordinates.map(|c| hand_q_at(profile, c)).collect() }
}

/// Joints of the free hand at `c`: `clip(M c, 0, 1)` of the range for driven joints, the tendon's share for the others.
fn hand_q_at(profile: &HandProfile, c: SynergyCoordinates) -> Vec<f64> {
    let row = |name: &str| profile.synergy_joints.iter().position(|n| n == name).map(|i| profile.synergy_matrix[i]);
    profile
        .joints
        .iter()
        .map(|joint| match row(&joint.name) {
            Some([m1, m2]) => {
                let closure = (m1 * c.c1 + m2 * c.c2).clamp(0.0, 1.0);
                joint.lower_rad + closure * (joint.upper_rad - joint.lower_rad)
            }
            None => (joint.closing_ratio * c.c1).clamp(joint.lower_rad, joint.upper_rad),
        })
        .collect()
}

fn check_grid(request: &PoseRequest<'_>) -> Result<(), PluginError> {
    let n = sfg_types::tsdf::EDGE.pow(3);
    let sizes = [request.tsdf.distances.len(), request.tsdf.weights.len(), request.affordance_region.len()];
    if sizes.iter().any(|&size| size != n) {
        return Err(failed(format!("the grid has {sizes:?} distances, weights and region flags; each must be {n}")));
    }
    Ok(())
}

fn failed(message: String) -> PluginError {
    PluginError::Failed { plugin: PLUGIN_NAME.to_owned(), message }
}
