//! The order of the house, held by reading its source: which folder may import from which.

mod code;
mod files;
mod imports;
mod order;
mod paths;

use code::{code, is_word, without_texts};
use files::rust_files;
use imports::{cycles, imports};
use order::{STAGES, against};

/// Words that name a kernel, or a field of physics that kernels come from, in lower case and without
/// underscores.
const KERNELS: [&str; 14] = [
    "biotsavart",
    "coulomb",
    "helmholtz",
    "inversedistance",
    "inversefourth",
    "inversesquare",
    "irradiance",
    "multiquadric",
    "plummer",
    "radiosity",
    "squareddistance",
    "stokeslet",
    "surfel",
    "yukawa",
];

/// What occlusion may take from the engine: numbers, points, and the registers that both are worked on in.
const NUMBERS: [&str; 6] = ["DispatchLevel", "Number", "Point", "Real", "Vector", "dispatch"];

#[test]
fn folders_of_the_engine_import_only_from_those_above() {
    let files = rust_files("src");
    let imports = imports(files.iter().map(|(name, text)| (name.as_str(), text.as_str())));
    assert!(imports.len() > 100, "{} imports: are paths still read?", imports.len());
    for stage in STAGES {
        let is_of = |name: &str| order::stage(name) == stage;
        assert!(files.iter().any(|(name, _)| is_of(name)), "src/ has no {stage}");
    }
    let strangers: Vec<&str> =
        files.iter().map(|(name, _)| name.as_str()).filter(|name| !order::is_known(name)).collect();
    assert!(strangers.is_empty(), "no place in the order of folders: {strangers:?}");
    let wrong = against(&imports);
    assert!(wrong.is_empty(), "imports against the order:\n{}", wrong.join("\n"));
}

#[test]
fn no_files_of_the_engine_import_in_a_circle() {
    let files = rust_files("src");
    let imports = imports(files.iter().map(|(name, text)| (name.as_str(), text.as_str())));
    let cycles = cycles(&imports);
    let edges = |cycle: &Vec<&str>| {
        let within = imports.iter().filter(|import| {
            cycle.contains(&import.from.as_str()) && cycle.contains(&import.to.as_str())
        });
        let lines =
            within.map(|import| format!("  {} → {}: {}", import.from, import.to, import.path));
        lines.collect::<Vec<_>>().join("\n")
    };
    let text: Vec<String> = cycles.iter().map(edges).collect();
    assert!(cycles.is_empty(), "{} circles:\n{}", cycles.len(), text.join("\n\n"));
}

#[test]
fn the_engine_names_no_kernel() {
    let files = rust_files("src");
    let named = files.iter().flat_map(|(name, text)| {
        kernels_named(text).into_iter().map(move |word| format!("{name}: {word}"))
    });
    let named: Vec<String> = named.collect();
    assert!(named.is_empty(), "kernels named in src/:\n{}", named.join("\n"));
}

#[test]
fn occlusion_and_scenes_know_no_sums() {
    let files = rust_files("kernels/radiosity/src/occlusion");
    let wrong = files.iter().flat_map(|(name, text)| {
        let names = names_of_the_engine(text).into_iter();
        let sums = names.filter(|path| !path.get(1).is_some_and(|name| NUMBERS.contains(&&**name)));
        sums.map(move |path| format!("{name}: {}", path.join("::")))
    });
    let wrong: Vec<String> = wrong.collect();
    assert!(wrong.is_empty(), "sums in the folder of occlusion:\n{}", wrong.join("\n"));
    let files = rust_files("scenes/src");
    let wrong = files.iter().flat_map(|(name, text)| {
        names_of_the_engine(text)
            .into_iter()
            .map(move |path| format!("{name}: {}", path.join("::")))
    });
    let wrong: Vec<String> = wrong.collect();
    assert!(wrong.is_empty(), "the engine in scenes:\n{}", wrong.join("\n"));
}

#[test]
fn files_belong_to_one_package() {
    let files = rust_files(".");
    let shared: Vec<&String> =
        files.iter().filter(|(_, text)| has_path_attribute(text)).map(|(name, _)| name).collect();
    assert!(shared.is_empty(), "`#[path]` borrows files from elsewhere: {shared:?}");
}

/// Words of the code of `text`, tests aside, that name a kernel.
fn kernels_named(text: &str) -> Vec<String> {
    let code = code(text);
    let words = code.split(|c| !is_word(c)).filter(|word| {
        let word = word.replace('_', "").to_lowercase();
        KERNELS.iter().any(|kernel| word.contains(kernel))
    });
    words.map(String::from).collect()
}

/// Paths in the code of `text`, tests aside, that start with the engine's name.
fn names_of_the_engine(text: &str) -> Vec<paths::Path> {
    let mut open = vec![paths::parse(&code(text))];
    let mut found = Vec::new();
    while let Some(module) = open.pop() {
        let uses = module.uses.into_iter().map(|leaf| leaf.path);
        found.extend(uses.chain(module.inline).filter(|path| path[0] == "farfield"));
        open.extend(module.nested.into_iter().map(|(_, nested)| nested));
    }
    found
}

fn has_path_attribute(text: &str) -> bool {
    let dense: String = without_texts(text).split_whitespace().collect();
    dense.contains("#[path=")
}

#[test]
fn kernels_are_found_in_code_alone() {
    let text = "//! Yukawa\nfn scale_of_yukawa() -> InverseDistance<f64> { \"Stokeslet\" } \
                #[cfg(test)] mod tests { use irradiance::X; } type BiotSavartLaw = Gauss;";
    assert_eq!(kernels_named(text), ["scale_of_yukawa", "InverseDistance", "BiotSavartLaw"]);
}

#[test]
fn the_engine_is_found_by_its_own_name() {
    let text = "use farfield::{Real, Fmm}; use farfield_scenes::X; use crate::farfield; \
                mod a { fn f() { farfield::direct(x) } } #[cfg(test)] mod tests { use farfield::Y; }";
    let names: Vec<String> = names_of_the_engine(text).iter().map(|path| path.join("::")).collect();
    assert_eq!(names, ["farfield::Real", "farfield::Fmm", "farfield::direct"]);
}

#[test]
fn borrowed_files_are_found() {
    assert!(has_path_attribute("# [ path = \"../a.rs\" ] mod a;"));
    assert!(!has_path_attribute("// #[path = \"../a.rs\"]\n#[paths] mod path;"));
}
