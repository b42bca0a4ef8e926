//! The order of the engine's folders.

use crate::imports::Import;

/// The engine's folders, each of which imports only from those above it; `dispatch_level` and `error` are single files.
pub(crate) const STAGES: [&str; 15] = [
    "dispatch_level",
    "error",
    "parallel",
    "linalg",
    "numbers",
    "octree",
    "kernel",
    "expansion",
    "interaction",
    "interpolation",
    "plan",
    "periodic",
    "certificate",
    "conformance",
    "guide",
];

/// The folder of a file, or the file itself: `octree` for `octree/tree.rs`, `error` for `error.rs`.
pub(crate) fn stage(file: &str) -> &str {
    file.split('/').next().unwrap_or_default().trim_end_matches(".rs")
}

/// Whether the order has a place for a file. The root, `lib.rs`, imports from all and is imported by none.
pub(crate) fn is_known(file: &str) -> bool {
    let stage = stage(file);
    STAGES.contains(&stage) || stage == "lib"
}

/// What is wrong with each import that goes against the order.
pub(crate) fn against(imports: &[Import]) -> Vec<String> {
    let wrong = imports.iter().filter(|import| {
        let [from, to] = [&import.from, &import.to].map(|file| stage(file));
        let place = |stage: &str| STAGES.iter().position(|other| *other == stage);
        // What has no place may be imported from nowhere but itself, and import nothing.
        let downwards = place(from).zip(place(to)).is_some_and(|(from, to)| to <= from);
        from != "lib" && from != to && !downwards
    });
    wrong
        .map(|import| format!("{} imports {} from {}", import.from, import.path, import.to))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imports::imports;

    fn wrong(files: &[(&str, &str)]) -> Vec<String> {
        against(&imports(files.iter().copied()))
    }

    #[test]
    fn imports_from_above_are_in_order() {
        let files = [
            ("lib.rs", "mod error; mod octree; mod plan; pub use plan::Plan;"),
            ("error.rs", "use std::fmt;"),
            ("octree/mod.rs", "mod tree; pub(crate) use tree::Tree;"),
            ("octree/tree.rs", "use crate::error::Error; use super::Tree as Same;"),
            ("plan/mod.rs", "use crate::{error::Error, octree::Tree};"),
        ];
        assert_eq!(wrong(&files), [""; 0]);
    }

    #[test]
    fn a_reversed_import_is_reported() {
        let files = [
            ("lib.rs", "mod octree; mod plan; pub use plan::Plan;"),
            ("octree/tree.rs", "fn f(plan: &crate::Plan) {}"),
            ("plan/mod.rs", "use crate::octree::tree::Tree;"),
        ];
        assert_eq!(wrong(&files), ["octree/tree.rs imports crate::Plan from plan/mod.rs"]);
    }

    #[test]
    fn folders_without_a_place_are_reported() {
        let files =
            [("plan/mod.rs", "use crate::shed::Rake;"), ("shed.rs", "use crate::plan::Plan;")];
        let expected = [
            "plan/mod.rs imports crate::shed::Rake from shed.rs",
            "shed.rs imports crate::plan::Plan from plan/mod.rs",
        ];
        assert_eq!(wrong(&files), expected);
        assert!(!is_known("shed.rs") && is_known("plan/mod.rs") && is_known("lib.rs"));
    }
}
