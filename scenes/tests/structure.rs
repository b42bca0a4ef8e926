//! The folders of this crate import only downwards, its files form no cycle, and none of them knows how
//! light is exchanged.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The folders from the lowest on.
const FOLDERS: [&str; 7] =
    ["scene", "repair", "generators", "formats", "cutting", "pictures", "output"];

/// What files may take from `farfield-radiosity`: geometry and occlusion, and why there is none.
const GEOMETRY: [&str; 8] =
    ["Element", "Error", "Hit", "Occluders", "Patch", "Segment", "Surfel", "Triangle"];

#[test]
fn folders_import_only_downwards() {
    let level = |file: &str| {
        let folder = file.split("::").next().unwrap_or_default();
        FOLDERS.iter().position(|known| *known == folder)
    };
    for (file, imports) in imports() {
        let Some(own) = level(&file) else {
            assert_eq!(file, "lib", "a file outside of the known folders");
            continue;
        };
        for import in imports {
            let other = level(&import).unwrap_or_else(|| panic!("{file} imports {import}"));
            assert!(other <= own, "{file} imports {import}, which is above it");
        }
    }
}

#[test]
fn no_file_imports_itself_by_way_of_others() {
    let imports = imports();
    for start in imports.keys() {
        let mut reached = BTreeSet::new();
        let mut next: Vec<&String> = imports[start].iter().collect();
        while let Some(file) = next.pop() {
            assert_ne!(file, start, "a cycle through {reached:?}");
            if reached.insert(file) {
                next.extend(imports.get(file).into_iter().flatten());
            }
        }
    }
}

#[test]
fn no_file_knows_how_light_is_exchanged() {
    for (file, text) in files() {
        // Tests may compare with anything.
        let text = text.split("\nmod tests {").next().unwrap_or_default();
        let words = text.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
        for word in words.filter(|word| word.starts_with("farfield") && word.contains("::")) {
            let krate = word.split("::").next().unwrap_or_default();
            assert!(["farfield_radiosity", "farfield_scenes"].contains(&krate), "{file}: {word}");
        }
        for import in text.split("farfield_radiosity::").skip(1) {
            let list = match import.strip_prefix('{') {
                Some(list) => list.split('}').next().unwrap_or_default(),
                None => import.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default(),
            };
            for item in list.split(',').map(str::trim).filter(|item| !item.is_empty()) {
                assert!(GEOMETRY.contains(&item), "{file} uses {item} of farfield-radiosity");
            }
        }
    }
}

#[test]
fn one_place_builds_the_tree_of_occluders() {
    // Before there is a mesh, closed rooms are looked at with all surfaces a little off their places.
    // Tests may build any number of them.
    let builds = |text: &str| text.split("#[cfg(test)]").next()?.find("Occluders::new(");
    let builders: Vec<_> = files()
        .into_iter()
        .filter(|(_, text)| builds(text).is_some())
        .map(|(file, _)| file)
        .collect();
    assert_eq!(builders, ["pictures::sight", "repair::facing"]);
}

/// For each file, as `folder::file`, the other files that it imports from.
fn imports() -> BTreeMap<String, BTreeSet<String>> {
    let files = files();
    // The longest name of a file that a path starts with.
    let file_of = |path: &str| {
        let known = |end: usize| files.contains_key(&path[..end]);
        let ends = path.match_indices("::").map(|(end, _)| end).chain([path.len()]);
        ends.filter(|&end| known(end)).max().map(|end| path[..end].to_owned())
    };
    let imports_of = |(file, text): (&String, &String)| {
        let mut found = BTreeSet::new();
        for (marker, prefix) in [("crate::", ""), ("self::", file.as_str())] {
            for (at, _) in text.match_indices(marker) {
                let inner = text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
                let rest = &text[at + marker.len()..];
                let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
                let end = rest.find(|c: char| !is_path(c)).unwrap_or(rest.len());
                let path = rest[..end].trim_end_matches(':');
                let separator = if prefix.is_empty() { "" } else { "::" };
                // Lists of files, as in `crate::formats::{obj, stl}`.
                let list = rest[end..].strip_prefix('{').and_then(|list| list.split('}').next());
                let items = list.unwrap_or_default().split(',').map(str::trim);
                let whole = items.map(|item| format!("{prefix}{separator}{path}::{item}"));
                found.extend(whole.filter(|_| !inner).filter_map(|path| file_of(&path)));
            }
        }
        found.remove(file);
        (file.clone(), found)
    };
    files.iter().map(imports_of).collect()
}

/// The sources by their names, `folder::file`, a folder's own file by that of the folder.
fn files() -> BTreeMap<String, String> {
    fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).expect("the sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                collect(&path, files);
            } else {
                files.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    collect(&root, &mut paths);
    let name = |path: &Path| {
        let inner = path.strip_prefix(&root).expect("below it").with_extension("");
        let names: Vec<_> = inner.iter().map(|name| name.to_string_lossy().into_owned()).collect();
        let names = names.strip_suffix(&["mod".to_owned()]).unwrap_or(&names);
        names.join("::")
    };
    let text = |path: &PathBuf| fs::read_to_string(path).expect("readable");
    paths.iter().map(|path| (name(path), text(path))).collect()
}
