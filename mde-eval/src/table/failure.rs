use serde::Serialize;
use std::collections::BTreeMap;

/// An error of a scene or of one of its methods.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Failure {
    /// The scene.
    pub scene: String,
    /// The method; none if the scene itself could not be loaded.
    pub method: Option<String>,
    /// What is wrong.
    pub error: String,
}

/// What failed, one line for each method and reason.
pub fn failed(failures: &[Failure]) -> Vec<String> {
    let mut groups: BTreeMap<(&str, &str), Vec<&str>> = BTreeMap::new();
    for failure in failures {
        let method = failure.method.as_deref().unwrap_or("all methods");
        groups.entry((method, &failure.error)).or_default().push(&failure.scene);
    }
    let line = |((method, error), scenes): ((&str, &str), Vec<&str>)| match scenes.as_slice() {
        [scene] => format!("failed: {method} on {scene}: {error}"),
        scenes => format!("failed: {method} on {} scenes: {error}", scenes.len()),
    };
    groups.into_iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_failures_take_one_line() {
        let failure = |scene: &str, method: Option<&str>, error: &str| Failure {
            scene: scene.to_owned(),
            method: method.map(str::to_owned),
            error: error.to_owned(),
        };
        let all = [failure("a", Some("zoom"), "x"), failure("b", Some("zoom"), "x"), failure("a", None, "y")];
        assert_eq!(failed(&all), ["failed: all methods on a: y", "failed: zoom on 2 scenes: x"]);
    }
}
