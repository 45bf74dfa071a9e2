#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::*;
use sfg_types::{
    ColourName, GraspFunctionality, Instruction, ObjectCluster, Point, RankedName, SceneInventory, ShapeClass, Vector,
};

/// What the geometric grounder would say about a thing: form, size and ranked guesses.
fn guesses(thing: &str) -> (ShapeClass, [f64; 3], Vec<(&'static str, f64)>) {
    use ShapeClass::{Blob, Box, Elongated, UprightCylinder, WideRound};
    match thing {
        "bottle" => (UprightCylinder, [0.07, 0.07, 0.22], vec![("bottle", 0.95), ("can", 0.15)]),
        "spray" => (UprightCylinder, [0.08, 0.08, 0.25], vec![("bottle", 0.7), ("pitcher", 0.2)]),
        "can" => (UprightCylinder, [0.066, 0.066, 0.12], vec![("can", 0.9), ("jar", 0.4), ("cup", 0.3)]),
        "mug" => (UprightCylinder, [0.12, 0.08, 0.095], vec![("mug", 0.9), ("cup", 0.3)]),
        "cup" => (UprightCylinder, [0.08, 0.08, 0.09], vec![("cup", 0.9), ("glass", 0.5), ("mug", 0.3)]),
        "bowl" => (WideRound, [0.16, 0.16, 0.065], vec![("bowl", 0.95), ("plate", 0.2)]),
        "plate" => (WideRound, [0.22, 0.22, 0.022], vec![("plate", 0.9), ("lid", 0.2)]),
        "lid" => (WideRound, [0.16, 0.16, 0.05], vec![("lid", 0.8), ("plate", 0.3)]),
        "pan" => (WideRound, [0.42, 0.24, 0.05], vec![("pan", 0.9), ("pot", 0.3)]),
        "pot" => (WideRound, [0.2, 0.2, 0.14], vec![("pot", 0.8), ("bowl", 0.3)]),
        "pitcher" => (UprightCylinder, [0.16, 0.11, 0.2], vec![("pitcher", 0.85), ("mug", 0.25)]),
        "hammer" => (Elongated, [0.32, 0.11, 0.03], vec![("hammer", 0.9), ("spatula", 0.3)]),
        "spatula" => (Elongated, [0.35, 0.08, 0.02], vec![("spatula", 0.9), ("spoon", 0.3)]),
        "spoon" => (Elongated, [0.2, 0.04, 0.015], vec![("spoon", 0.8), ("spatula", 0.25)]),
        "whisk" => (Elongated, [0.28, 0.06, 0.05], vec![("whisk", 0.8), ("spatula", 0.3)]),
        "screwdriver" => (Elongated, [0.22, 0.03, 0.03], vec![("screwdriver", 0.9), ("knife", 0.2)]),
        "scissors" => (Elongated, [0.2, 0.08, 0.012], vec![("scissors", 0.7), ("spatula", 0.4)]),
        "knife" => (Elongated, [0.25, 0.03, 0.015], vec![("knife", 0.8), ("screwdriver", 0.3)]),
        "pen" => (Elongated, [0.14, 0.014, 0.014], vec![("pen", 0.9)]),
        "ball" => (Blob, [0.07, 0.07, 0.07], vec![("ball", 0.95)]),
        "box" => (Box, [0.16, 0.06, 0.2], vec![("box", 0.9)]),
        "stapler" => (Box, [0.14, 0.04, 0.06], vec![("box", 0.8)]),
        "mouse" => (Box, [0.11, 0.06, 0.04], vec![("box", 0.6), ("ball", 0.3)]),
        "headset" => (Blob, [0.18, 0.16, 0.08], vec![("box", 0.4), ("bowl", 0.3)]),
        "drill" => (Box, [0.2, 0.07, 0.18], vec![("box", 0.6), ("hammer", 0.2)]),
        "wineglass" => (UprightCylinder, [0.08, 0.08, 0.2], vec![("glass", 0.6), ("bottle", 0.2)]),
        other => panic!("no such thing: {other}"),
    }
}

/// `red mug, bowl`: the things from left to right, 20 cm apart; `tall` and `small` change the size.
fn scene(text: &str) -> SceneInventory {
    let things = text.split(',').map(str::trim).filter(|thing| !thing.is_empty());
    let clusters = (0_u32..).zip(things).map(|(id, thing)| {
        let (mut colour, mut scale, mut kind) = (ColourName::White, 1.0, "");
        for word in thing.split(' ') {
            match word {
                "red" => colour = ColourName::Red,
                "blue" => colour = ColourName::Blue,
                "green" => colour = ColourName::Green,
                "tall" => scale = 1.3,
                "small" => scale = 0.8,
                other => kind = other,
            }
        }
        let (shape, size, names) = guesses(kind);
        ObjectCluster {
            id,
            size_m: Vector::from(size) * scale,
            yaw_rad: 0.0,
            centre_in_base: Point::new(0.6, 0.4 - 0.2 * f64::from(id), 0.75 + size[2] * scale / 2.0),
            colour,
            shape,
            names: names.into_iter().map(|(name, score)| RankedName { name: name.to_owned(), score }).collect(),
            points_in_base: Vec::new(),
        }
    });
    SceneInventory { clusters: clusters.collect(), table_height_m: 0.75 }
}

fn backend(without_novel: bool) -> KnowledgeBackend {
    let knowledge = Knowledge::embedded().unwrap();
    KnowledgeBackend::from_knowledge(if without_novel { knowledge.without_novel() } else { knowledge })
}

fn answer(backend: &mut KnowledgeBackend, things: &str, sentence: &str) -> FunctionalityAnswer {
    let (instruction, inventory) = (Instruction::new(sentence).unwrap(), scene(things));
    backend.infer(&FunctionalityRequest { instruction: &instruction, inventory: &inventory }).unwrap()
}

/// `task thing part type [target]`, the thing and the target by their position on the table, `-` = none; `a/b` = either.
fn acts_as_expected(f: &GraspFunctionality, expected: &str) -> bool {
    let fields: Vec<&str> = expected.split_whitespace().collect();
    let is = |i: usize, actual: &str| {
        fields.get(i).is_none_or(|field| field.split('/').any(|option| option == actual || option == "*"))
    };
    let target = f.target.as_ref().map_or("-".to_owned(), |target| target.cluster_id.to_string());
    is(0, f.task.name())
        && is(1, &f.object.cluster_id.to_string())
        && is(2, &f.affordance)
        && is(3, f.grasp_type.name())
        && is(4, &target)
        && (0.0..=1.0).contains(&f.confidence)
        && !f.rationale.is_empty()
}

/// Lines `things | sentence | expected`; all misses are shown at once.
#[track_caller]
fn check_lines(backend: &mut KnowledgeBackend, lines: &str) {
    let mut misses = Vec::new();
    let mut n = 0;
    for line in lines.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let [things, sentence, expected] = line.split('|').map(str::trim).collect::<Vec<_>>().try_into().unwrap();
        n += 1;
        let answer = answer(backend, things, sentence);
        let right = match &answer {
            FunctionalityAnswer::Act(f) => acts_as_expected(f, expected),
            FunctionalityAnswer::Ask { choices, question } => expected == "ask" && choices.len() >= 2 && !question.is_empty(),
            FunctionalityAnswer::Refuse { reason } => expected == "refuse" && !reason.is_empty(),
        };
        if !right {
            misses.push(format!("{line}\n    {answer:?}"));
        }
    }
    assert!(misses.is_empty(), "{} of {n} lines missed:\n{}", misses.len(), misses.join("\n"));
}

#[test]
fn sentences_of_the_paper_are_understood() {
    check_lines(
        &mut backend(false),
        "
        bottle, bowl | pour the milk into my bowl | pour 0 body large_diameter 1
        scissors, mug, bowl | Hand me the scissors, please | hand_over 0 blade palmar_pinch/tripod -
        lid, pot, cup | take the lid off the pot | pick_up 0 knob precision_disk *
        spatula, pan, mug | stir-fry the vegetables in the pan with the spatula | stir_fry 0 handle adducted_thumb 1
        spatula, pan | Stir fry the vegetables | stir_fry 0 handle adducted_thumb 1/-
        red mug, bowl | Hang the mug on the hook | hang 0 body large_diameter/medium_wrap -
        spoon, headset, cup | hang the headset up | hang 1 band fixed_hook -
        whisk, bowl, bottle | Whisk the eggs in the bowl | whisk 0 handle medium_wrap 1
        lid, bowl, mug | cover the bowl with the lid | cover 0 knob precision_disk 1
        lid, pan, mug | put the lid on the pan | cover 0 knob precision_disk 1
        spray, box, mug | hand me the detergent | hand_over 0 body large_diameter -
        pen, mug | take off the pen cap | */use/pick_up 0 cap palmar_pinch/tripod -
        knife, ball | cut the apple with the knife | use 0 handle index_finger_extension */-
        knife, mug | pass me the knife | hand_over 0 blade palmar_pinch -
    ",
    );
}

#[test]
fn novel_objects_are_known() {
    check_lines(
        &mut backend(false),
        "
        spoon, bowl | give me the spoon | hand_over 0 bowl palmar_pinch/tripod -
        can, mug | grab the soda can | pick_up 0 body large_diameter -
        pan, bowl | lift the frying pan | pick_up 0 handle medium_wrap/large_diameter -
        spray, cup | spray the window with the spray bottle | use 0 neck index_finger_extension -
        spray, cup | clean the mirror with the detergent | use 0 neck index_finger_extension -
        mouse, mug | click with the mouse | use 0 body power_sphere -
        stapler, cup | pass me the stapler | hand_over 0 body prismatic_four_finger -
        headset, cup | bring me the headphones | hand_over 0 band fixed_hook/large_diameter -
        whisk, cup | hand me the whisk | hand_over 0 wires power_sphere/large_diameter -
        bottle, cup | open the bottle | use 0 cap tripod/palmar_pinch -
    ",
    );
}

#[test]
fn pouring_is_understood_in_many_wordings() {
    check_lines(
        &mut backend(false),
        "
        bottle, bowl | Pour the water from the bottle into the bowl. | pour 0 body large_diameter 1
        bottle, bowl, red mug, box | Could you please pour some water into the bowl? | pour 0 body large_diameter 1
        bowl, bottle | fill the bowl with water | pour 1 body large_diameter 0
        bottle, mug | pour me a cup of water | pour 0 body large_diameter 1
        pitcher, cup | pour the juice into the cup | pour 0 handle medium_wrap 1
        pitcher, cup | Pour juice from the jug in the cup | pour 0 handle medium_wrap 1
        blue mug, bowl | empty the mug into the bowl | pour 0 body large_diameter 1
        bottle, bowl | pick up the bottle and pour it into the bowl | pour 0 body large_diameter 1
        bottle, bowl | Take the bottle, then pour its contents in the bowl | pour 0 body large_diameter 1
        red mug, blue mug, bowl | pour the coffee from the red mug into the bowl | pour 0 body large_diameter 2
        bottle, green mug, red mug | pour the water into the red mug | pour 0 body large_diameter 2
        bottle, bowl | puor the watter into the bowl | pour 0 body large_diameter 1
        bottle, bowl | I'd like you to pour the milk into the bowl | pour 0 body large_diameter 1
        bottle, bowl | POUR THE BOTTLE INTO THE BOWL!!! | pour 0 body large_diameter 1
        can, cup | pour the cola into the cup | pour 0 body large_diameter 1
        bottle, bowl, can | tip the bottle into the bowl | pour 0 body large_diameter 1
        box, bowl | pour the cereal into the bowl | pour 0 body */large_diameter 1
    ",
    );
}

#[test]
fn tools_are_held_for_their_use() {
    check_lines(
        &mut backend(false),
        "
        hammer, mug | hammer the nail in | use 0 handle small_diameter/medium_wrap -
        hammer, screwdriver | use the hammer | use 0 handle small_diameter/medium_wrap -
        hammer, screwdriver | hit the nail with the hammer | use 0 handle small_diameter/medium_wrap -
        hammer, screwdriver | I need the hammer | hand_over 0 head * -
        hammer, screwdriver | tighten the screw | use 1 handle small_diameter/medium_wrap -
        hammer, screwdriver | give me something to drive this nail in | hand_over 0 head * -
        scissors, pen | give me something to cut paper with | hand_over 0 blade * -
        drill, mug | drill a hole in the wall | use 0 handle index_finger_extension -
        pen, cup | write a note | use 0 body tripod -
        spoon, bowl | stir the soup with the spoon | stir_fry 0 handle adducted_thumb/tripod 1/-
        spatula, pan | use the spatula to stir the vegetables in the pan | stir_fry 0 handle adducted_thumb 1
        spatula, pan | flip the pancake | use 0 handle adducted_thumb *
        mug, spoon | drink from the mug | use 0 handle lateral/medium_wrap -
        wineglass, cup | pick up the wine glass | pick_up 0 stem tripod -
        knife, bowl | I want to slice the bread | use 0 handle index_finger_extension -
        scissors, bowl | cut the paper with the scissors | use 0 handle tripod -
    ",
    );
}

#[test]
fn references_find_their_thing() {
    check_lines(
        &mut backend(false),
        "
        red mug, blue mug | hand me the red mug | hand_over 0
        red mug, blue mug | hand me the blue one | hand_over 1
        bottle, bottle, bowl | pick up the left bottle | pick_up 0 body large_diameter
        bottle, bottle, bowl | pick up the bottle on the right | pick_up 1 body large_diameter
        tall bottle, small bottle | grab the tall bottle | pick_up 0
        bottle, small bottle | grab the smaller bottle | pick_up 1
        mug, bottle, box | pick up the tallest thing | pick_up 1
        red can, blue can, green can | take the green can | pick_up 2
        red bowl, blue bowl, bottle | pour the milk into the blue bowl | pour 2 body large_diameter 1
        red mug, blue mug, mug | give me the middle-sized red mug | hand_over 0
        mug, bowl | take the mug by its handle | pick_up 0 handle
        mug, bowl | grab the mug by the rim | pick_up 0 rim
        mug, bowl | grab the handle of the mug | pick_up 0 handle
        mug, ball | bring the ball to me | hand_over 1 body power_sphere
        mug, bottle | pick up the botle | pick_up 1 body large_diameter
        mug, bowl, box | lift it up, the box I mean | pick_up 2
        bottle, box | pick the box up | pick_up 1 body prismatic_four_finger
        bottle, box | put the box on the table | pick_up 1
    ",
    );
}

#[test]
fn open_choices_are_asked() {
    check_lines(
        &mut backend(false),
        "
        red mug, blue mug | hand me the mug | ask
        bottle, red bowl, blue bowl | pour the water into the bowl | ask
        bottle, bottle, bowl | pour the water into the bowl | ask
        blue mug, bowl | hand me the red mug | ask
        mug, bowl | the mug | ask
        mug, bowl | do something nice | ask
        mug, bowl | hand me the gizmo | ask
        mug, ball | pick up the bal | ask
        mug, bowl, box | pick it up | ask
        bottle, cup, bowl, mug | pour some water | ask
    ",
    );
}

#[test]
fn absent_and_unsafe_things_are_refused() {
    check_lines(
        &mut backend(false),
        "
        bottle, bowl | hand me the hammer | refuse
        bottle, mug | pour the water into the bowl | refuse
        ball, bowl | pour the milk into the bowl | refuse
        bottle, bowl | cut the bread | refuse
        knife, mug | stab the potato | refuse
        hammer, mug | hit him with the hammer | refuse
        knife, mug | cut my finger with the knife | refuse
        bottle, mug | pour the hot water over the child | refuse
        bottle, bowl | Don't pour the milk into the bowl | refuse
        | hand me the mug | refuse
        mug, knife | throw the knife at her | refuse
        lid, mug | cover the pan with the lid | refuse
    ",
    );
}

#[test]
fn refusals_say_what_is_there() {
    let FunctionalityAnswer::Refuse { reason } = answer(&mut backend(false), "red mug, bowl", "hand me the hammer") else {
        panic!("a hammer that is not there")
    };
    assert!(reason.contains("a red mug and a white bowl") && reason.contains("no hammer"), "{reason}");
    let FunctionalityAnswer::Ask { choices, .. } = answer(&mut backend(false), "red mug, red mug, blue mug", "hand me the mug")
    else {
        panic!("three mugs")
    };
    assert_eq!(choices, ["the red mug on the left", "the red mug on the right", "the blue mug"]);
}

#[test]
fn entries_are_surer_than_rules_and_rules_than_kin() {
    let confidence = |backend: &mut KnowledgeBackend, things: &str, sentence: &str| match answer(backend, things, sentence) {
        FunctionalityAnswer::Act(f) => f.confidence,
        other => panic!("{other:?}"),
    };
    let entry = confidence(&mut backend(false), "bottle, bowl", "pour the water into the bowl");
    let rule = confidence(&mut backend(false), "can, bowl", "hang the can");
    let kin = confidence(&mut backend(true), "bottle, bowl", "pour the bottle into the bowl");
    assert!(entry > 0.9 && (0.55..0.85).contains(&rule) && kin < 0.6, "{entry} {rule} {kin}");
}

#[test]
fn without_the_novel_objects_kin_and_form_decide() {
    check_lines(
        &mut backend(true),
        "
        bottle, bowl | pour the water from the bottle into the bowl | pour 0 body large_diameter 1
        bottle, cup | hand me the bottle | hand_over 0 body large_diameter -
        can, cup | grab the can | pick_up 0 body large_diameter -
        spoon, bowl | hand me the spoon | hand_over 0 * * -
        stapler, cup | pass me the stapler | ask
    ",
    );
}

#[test]
fn parameters_are_checked() {
    for (params, expected) in [
        (serde_json::json!({"without_novel": true}), None),
        (serde_json::json!({}), None),
        (serde_json::json!({"without_novle": true}), Some("without_novle")),
        (serde_json::json!({"without_novel": 3}), Some("true or false")),
    ] {
        let hand = serde_json::from_value(serde_json::json!({
            "name": "h", "urdf_left": "", "urdf_right": "", "palm_link": "", "joints": [], "synergy_joints": [], "synergy_matrix": [],
            "grasp_types": {}, "max_tension_nm": 1.0, "tendon_stiffness_nm_per_rad": 1.0, "max_current_amps": 1.0,
            "max_closing_speed_per_sec": 1.0
        }))
        .unwrap();
        let context = PluginContext {
            params: &params,
            scenarios_dir: std::path::Path::new("."),
            hand: &hand,
            hand_side: sfg_types::HandSide::default(),
            seed: 0,
        };
        let made = KnowledgeBackend::new(&context);
        match expected {
            None => assert!(made.is_ok()),
            Some(part) => {
                let error = made.err().unwrap();
                assert!(matches!(error, PluginError::BadParameter { .. }) && error.to_string().contains(part), "{error}");
            }
        }
    }
}

#[test]
fn any_text_gets_an_answer_quickly() {
    let mut backend = backend(false);
    let pieces = [
        "pour", "the", "mug", "ü", "…", "into", "of", "into", "and", "it", "'", "stab-", "12", "可", "red", "left", "lid", "off",
        "with",
    ];
    let started = std::time::Instant::now();
    let mut state = 7_usize;
    for length in 1..200 {
        let text: Vec<&str> = (0..length % 25 + 1)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                pieces[(state >> 33) % pieces.len()]
            })
            .collect();
        let _ = answer(&mut backend, "bottle, bowl, red mug", &text.join(" "));
    }
    // The budget is 5 ms a sentence in release; a development build on a busy machine gets four times that.
    assert!(started.elapsed().as_millis() < 200 * 20, "{:?}", started.elapsed());
}
