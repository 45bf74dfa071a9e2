//! Laws of a driver.

use super::Laws;
use crate::Driver;
use sfg_types::{HandCommand, RobotCommand, RobotState};

/// Periods for which a still command is held.
const N_PERIODS: usize = 25;
/// How far a robot that holds may be from its set point, radians.
const HOLD_TOLERANCE_RAD: f64 = 0.05;

/// Every law that `driver` breaks, on a robot at rest: time advances by one period a call, states are finite and about the acting
/// side, a robot told to stay stays, views have the size of their intrinsics, commands that are not numbers or of the wrong
/// length are refused, and `stop` works twice and from any state.
///
/// # Errors
/// The broken laws, a sentence each.
pub fn driver_suite(driver: &mut dyn Driver) -> Result<(), Vec<String>> {
    let mut laws = Laws::default();
    let info = driver.info();
    laws.check(!info.name.is_empty(), || "the driver has no name".into());
    laws.check(info.period_secs.is_finite() && info.period_secs > 0.0, || format!("a period of {} s", info.period_secs));
    laws.ok("stop before any command", driver.stop());
    check_observation(driver, &mut laws);

    let Some(start) = check_state("at the start", driver, &mut laws) else { return laws.into_result() };
    let hold = RobotCommand { side: info.side, dq: vec![0.0; start.q.len()], q: start.q.clone(), hand: HandCommand::default() };
    for i in 1..=N_PERIODS {
        let sent = driver.command(&hold).and_then(|()| driver.advance());
        if laws.ok(&format!("hold, period {i}"), sent).is_none() {
            return laws.into_result();
        }
        let Some(now) = check_state(&format!("hold, period {i}"), driver, &mut laws) else { break };
        let late = now.stamp_secs - start.stamp_secs - i as f64 * info.period_secs;
        laws.check(late.abs() < 1e-6, || format!("after {i} periods the clock is {late} s off"));
        let drift = now.q.iter().zip(&start.q).map(|(now, then)| (now - then).abs()).fold(0.0, f64::max);
        laws.check(drift < HOLD_TOLERANCE_RAD, || format!("told to stay, it moved by {drift:.4} rad in {i} periods"));
    }
    refused_commands(driver, &hold, &mut laws);
    for case in ["stop", "stop again"] {
        laws.ok(case, driver.stop());
    }
    laws.ok("advance after the stop", driver.advance());
    check_state("after the stop", driver, &mut laws);
    laws.into_result()
}

fn refused_commands(driver: &mut dyn Driver, hold: &RobotCommand, laws: &mut Laws) {
    type Spoil = fn(&mut RobotCommand);
    let spoils: [(&str, Spoil); 6] = [
        ("a joint position that is not a number", |command| command.q[0] = f64::NAN),
        ("an infinite joint velocity", |command| command.dq[0] = f64::INFINITY),
        ("a hand set point that is not a number", |command| command.hand.synergy = f64::NAN),
        ("a second hand set point that is not a number", |command| command.hand.manipulation = f64::NAN),
        ("one joint too few", |command| {
            command.q.pop();
            command.dq.pop();
        }),
        ("no joint at all", |command| {
            command.q.clear();
            command.dq.clear();
        }),
    ];
    for (case, spoil) in spoils {
        let mut command = hold.clone();
        spoil(&mut command);
        laws.check(driver.command(&command).is_err(), || format!("a command with {case} was accepted"));
        // A refusal leaves the driver usable.
        laws.ok(&format!("a good command after one with {case}"), driver.command(hold).and_then(|()| driver.advance()));
        check_state(&format!("after a command with {case}"), driver, laws);
    }
}

fn check_state(case: &str, driver: &mut dyn Driver, laws: &mut Laws) -> Option<RobotState> {
    let state = laws.ok(case, driver.state())?;
    laws.check(state.side == driver.info().side, || format!("{case}: the state is about the {} arm", state.side.name()));
    laws.check(!state.q.is_empty() && state.q.len() == state.dq.len(), || {
        format!("{case}: {} positions and {} velocities", state.q.len(), state.dq.len())
    });
    let hand = state.hand.motor_positions.iter().chain(&state.hand.motor_currents_amps);
    let finite = state.q.iter().chain(&state.dq).chain(hand).chain([&state.stamp_secs]).all(|value| value.is_finite());
    laws.check(finite, || format!("{case}: the state is not finite: {state:?}"));
    Some(state)
}

fn check_observation(driver: &mut dyn Driver, laws: &mut Laws) {
    let Some(observation) = laws.ok("observe", driver.observe()) else { return };
    for view in &observation.views {
        let n_pixels = view.intrinsics.width * view.intrinsics.height;
        let sized = view.rgb.len() == 3 * n_pixels && view.depth_m.len() == n_pixels;
        laws.check(sized, || format!("camera {:?}: buffers do not fit {n_pixels} pixels", view.camera));
        let depths = view.depth_m.iter().all(|depth| depth.is_finite() && *depth >= 0.0);
        laws.check(depths, || format!("camera {:?}: a depth is negative or not a number", view.camera));
    }
}
