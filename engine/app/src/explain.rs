//! The catalogue of failure reasons.

use crate::check::BadInput;
use sfg_tree::nearest;

/// The catalogue; one heading a reason.
const CATALOGUE: &str = include_str!("../../../scenarios/FAILURES.md");

/// Where the catalogue speaks of `reason`.
pub(crate) fn link(reason: &str) -> String {
    format!("scenarios/FAILURES.md#{reason}")
}

/// The entry of `reason`.
pub(crate) fn entry(reason: &str) -> Result<&'static str, BadInput> {
    let found = entries().find(|(name, _)| *name == reason).map(|(_, text)| text);
    found.ok_or_else(|| {
        let help = match nearest(reason, entries().map(|(name, _)| name)) {
            Some(near) => format!("did you mean {near:?}?"),
            None => format!("known are {}", entries().map(|(name, _)| name).collect::<Vec<_>>().join(", ")),
        };
        BadInput(format!("unknown failure reason {reason:?}; {help}"))
    })
}

/// Every reason with its entry.
fn entries() -> impl Iterator<Item = (&'static str, &'static str)> {
    CATALOGUE.split("\n## ").skip(1).map(|text| (text.lines().next().unwrap_or_default().trim(), text.trim()))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_types::FailureReason;
    use std::collections::BTreeSet;

    #[test]
    fn every_reason_has_exactly_one_entry_and_no_entry_is_unknown() {
        let reasons: BTreeSet<&str> =
            FailureReason::ALL.iter().map(|reason| reason.name()).chain(sfg_tree::reason::ALL.iter().copied()).collect();
        let listed: Vec<&str> = entries().map(|(name, _)| name).collect();
        assert_eq!(listed.len(), listed.iter().collect::<BTreeSet<_>>().len(), "an entry stands twice");
        assert_eq!(listed.into_iter().collect::<BTreeSet<_>>(), reasons);
    }

    #[test]
    fn every_entry_says_what_it_means_and_what_to_do() {
        for (name, text) in entries() {
            let lines: Vec<&str> = text.lines().filter(|line| !line.is_empty()).collect();
            assert!(lines.len() >= 3 && lines[1].ends_with('.') && text.contains("**Do:** "), "{name}: {text}");
        }
    }

    #[test]
    fn the_catalogue_says_what_the_types_say() {
        for reason in FailureReason::ALL {
            assert!(entry(reason.name()).unwrap().contains(reason.meaning()), "{reason}");
        }
    }

    #[test]
    fn an_unknown_reason_gets_the_nearest_one() {
        assert!(entry("no_pth").unwrap_err().to_string().ends_with("did you mean \"no_path\"?"));
    }
}
