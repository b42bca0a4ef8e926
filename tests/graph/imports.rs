//! Which file of a crate imports from which.

use std::collections::{BTreeMap, BTreeSet};

use crate::code::code;
use crate::paths::{Module, Path, Use, parse};

/// A file's import from another, both named relative to the crate's folder.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Import {
    pub(crate) from: String,
    pub(crate) to: String,
    /// The path as it is written.
    pub(crate) path: String,
}

/// All imports between the files of a crate, each pair with the first path that makes it. `files` are
/// pairs of a name, such as `octree/tree.rs`, and a text. Tests within the files don't count.
pub(crate) fn imports<'a>(files: impl IntoIterator<Item = (&'a str, &'a str)>) -> Vec<Import> {
    let mut modules = BTreeMap::new();
    for (file, text) in files {
        collect(file, module_path(file), parse(&code(text)), &mut modules);
    }
    let modules = Modules(modules);
    let mut imports = BTreeMap::new();
    for (path, (from, module)) in &modules.0 {
        for named in module.uses.iter().map(|leaf| &leaf.path).chain(&module.inline) {
            let to =
                modules.absolute(path, named).and_then(|path| modules.file(&path, &mut Vec::new()));
            if let Some(to) = to.filter(|to| to != from) {
                let path = named.join("::");
                let import = Import { from: from.clone(), to, path };
                imports.entry([import.from.clone(), import.to.clone()]).or_insert(import);
            }
        }
    }
    imports.into_values().collect()
}

/// Files that import from each other in a circle: each circle by the names of its files.
pub(crate) fn cycles(imports: &[Import]) -> Vec<Vec<&str>> {
    let mut reached: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for import in imports {
        reached.entry(&import.from).or_default().insert(&import.to);
    }
    let direct = reached.clone();
    for targets in reached.values_mut() {
        let mut open: Vec<&str> = targets.iter().copied().collect();
        while let Some(file) = open.pop() {
            let more = direct.get(file).into_iter().flatten();
            open.extend(more.filter(|next| targets.insert(next)));
        }
    }
    let both =
        |a: &str, b: &str| reached[a].contains(b) && reached.get(b).is_some_and(|r| r.contains(a));
    let mut cycles: Vec<Vec<&str>> = Vec::new();
    for &file in reached.keys().filter(|file| reached[**file].contains(**file)) {
        match cycles.iter_mut().find(|cycle| both(file, cycle[0])) {
            Some(cycle) => cycle.push(file),
            None => cycles.push(vec![file]),
        }
    }
    cycles
}

/// `octree/tree.rs` is `octree::tree`, `octree/mod.rs` and `octree.rs` are `octree`, `lib.rs` the root.
fn module_path(file: &str) -> Path {
    let names = file.trim_end_matches(".rs").trim_end_matches("/mod").split('/');
    names.filter(|name| *name != "lib").map(String::from).collect()
}

/// Registers a module and those within it.
fn collect(
    file: &str,
    path: Path,
    mut module: Module,
    into: &mut BTreeMap<Path, (String, Module)>,
) {
    for (name, nested) in std::mem::take(&mut module.nested) {
        collect(file, [path.clone(), vec![name]].concat(), nested, into);
    }
    into.insert(path, (file.to_owned(), module));
}

/// All modules by their paths from the root of the crate, each with its file.
struct Modules(BTreeMap<Path, (String, Module)>);

impl Modules {
    /// A path from the root of the crate; none if it leads to another crate or to a name in scope.
    fn absolute(&self, module: &[String], named: &[String]) -> Option<Path> {
        let mut base = module.to_vec();
        let mut rest = named;
        match named.first()?.as_str() {
            "crate" => (base, rest) = (Vec::new(), &named[1..]),
            "self" => rest = &named[1..],
            "super" => {}
            child => {
                base.push(child.to_owned());
                let is_child = self.0.contains_key(&base);
                base.pop();
                return is_child.then(|| [base.as_slice(), named].concat());
            }
        }
        while rest.first().is_some_and(|name| name == "super") {
            base.pop()?;
            rest = &rest[1..];
        }
        Some([base.as_slice(), rest].concat())
    }

    /// The file that defines what an absolute path names, wherever it is re-exported.
    fn file(&self, path: &[String], seen: &mut Vec<Path>) -> Option<String> {
        if seen.iter().any(|other| other == path) {
            return None;
        }
        seen.push(path.to_vec());
        let len = (0..=path.len()).rev().find(|&len| self.0.contains_key(&path[..len]))?;
        let (module, rest) = path.split_at(len);
        let (file, content) = &self.0[module];
        let Some(name) = rest.first().filter(|name| *name != "*") else {
            return Some(file.clone());
        };
        // Either it's imported by name, from this crate or another, …
        if let Some(Use { path, .. }) = content.uses.iter().find(|leaf| leaf.name == *name) {
            let target = self.absolute(module, path)?;
            return self.file(&[&target, &rest[1..]].concat(), seen);
        }
        // … or it's a macro, which the root exports wherever it's defined, …
        if module.is_empty() {
            let defines = |(_, content): &&(String, Module)| content.macros.contains(name);
            if let Some((file, _)) = self.0.values().find(defines) {
                return Some(file.clone());
            }
        }
        // … or it comes through a glob from a module that names it, or it's defined here.
        let globs = content.uses.iter().filter(|leaf| leaf.name == "*");
        let through = |leaf: &Use| {
            let target = self.absolute(module, &leaf.path[..leaf.path.len() - 1])?;
            let (_, exporter) = self.0.get(&target)?;
            let names = exporter.uses.iter().any(|leaf| leaf.name == *name);
            let inner = [&target, rest].concat();
            (names || self.0.contains_key(&inner[..=target.len()])).then_some(inner)
        };
        match globs.filter_map(through).next() {
            Some(inner) => self.file(&inner, seen),
            None => Some(file.clone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edges(files: &[(&str, &str)]) -> Vec<String> {
        let edge = |import: &Import| format!("{} → {}: {}", import.from, import.to, import.path);
        imports(files.iter().copied()).iter().map(edge).collect()
    }

    #[test]
    fn imports_lead_to_the_files_that_define() {
        let files = [
            ("lib.rs", "mod a; mod b; pub use b::Thing;"),
            ("a/mod.rs", "mod c; mod d; pub(crate) use c::C; fn f() { d::g(); } macro_rules! m {}"),
            ("a/c.rs", "use super::d::D; use crate::Thing; use std::fmt; pub struct C;"),
            (
                "a/d.rs",
                "fn h() -> crate::a::C { super::f() } #[cfg(test)] mod t { use crate::b::X; }",
            ),
            ("b.rs", "mod inner { use super::Thing; use crate::a::*; } pub struct Thing;"),
            ("e.rs", "fn f() { crate::m!(1); }"),
        ];
        let expected = [
            "a/c.rs → a/d.rs: super::d::D",
            "a/c.rs → b.rs: crate::Thing",
            "a/d.rs → a/c.rs: crate::a::C",
            "a/d.rs → a/mod.rs: super::f",
            "a/mod.rs → a/c.rs: c::C",
            "a/mod.rs → a/d.rs: d::g",
            "b.rs → a/mod.rs: crate::a::*",
            "e.rs → a/mod.rs: crate::m",
            "lib.rs → b.rs: b::Thing",
        ];
        assert_eq!(edges(&files), expected);
    }

    #[test]
    fn cycles_are_found_and_chains_are_none() {
        let chain = [
            ("a.rs", ""),
            ("b.rs", "use crate::a::A;"),
            ("c.rs", "use crate::{a::A, b::B};"),
            ("d.rs", "use crate::c::C;"),
        ];
        let chain_imports = imports(chain);
        assert_eq!((chain_imports.len(), cycles(&chain_imports).len()), (4, 0));
        let mut circle = chain;
        circle[0].1 = "fn f(c: &crate::c::C) {}";
        assert_eq!(cycles(&imports(circle)), [["a.rs", "b.rs", "c.rs"]]);
    }
}
