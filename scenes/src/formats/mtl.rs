//! Materials from the MTL files that OBJ files name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::formats::text::{Line, Lines, read_text};
use crate::scene::error::SceneError;
use crate::scene::material::Material;

/// The materials of all files that an OBJ file names.
#[derive(Clone, Debug, Default)]
pub(crate) struct Library {
    materials: BTreeMap<String, Entry>,
    /// What is named and isn't there, one sentence each.
    pub(crate) missing: Vec<String>,
    /// What was mended in materials that are in use, one sentence each.
    pub(crate) repairs: Vec<String>,
}

/// A material of a file.
#[derive(Clone, Debug)]
struct Entry {
    material: Material,
    /// Whether some of its reflectance was 1.
    is_white: bool,
    /// What of it is not read, one sentence each.
    unread: BTreeSet<&'static str>,
}

/// The most that a material reflects where a file says that it reflects everything.
const WHITEST: f64 = 0.999;

impl Library {
    /// Adds the files that the words after `mtllib` name, in `folder`. What isn't found is noted.
    ///
    /// # Errors
    /// [`SceneError::Read`], or [`SceneError::Line`] for a line that isn't what it should be.
    pub(crate) fn read(&mut self, folder: &Path, words: &[&str]) -> Result<(), SceneError> {
        for name in names(folder, words) {
            match find(folder, &name) {
                Some(path) => self.add_file(&path)?,
                None => self.missing.push(format!("material file `{name}` not found")),
            }
        }
        Ok(())
    }

    /// The material of a name; grey if there is none.
    pub(crate) fn material(&mut self, name: &str) -> Material {
        // What follows a `#` may be part of the name or a comment.
        let bare = |name: &str| name.split(" #").next().unwrap_or_default().to_owned();
        let entry = self.materials.get(name).or_else(|| self.materials.get(&bare(name)));
        let entry = entry.or_else(|| {
            let alike = self.materials.iter().find(|(known, _)| bare(known) == name);
            alike.map(|(_, entry)| entry)
        });
        if let Some(Entry { material, is_white, unread }) = entry {
            let note = |what: &&str| format!("material `{name}`: {what}");
            self.missing.extend(unread.iter().map(note));
            if *is_white {
                let what = "reflects everything, taken for 0.999";
                self.repairs.push(format!("material `{name}` {what}"));
            }
            return Material { name: name.to_owned(), ..material.clone() };
        }
        self.missing.push(if name.is_empty() {
            "faces without a material made grey".to_owned()
        } else {
            format!("material `{name}` not found, faces made grey")
        });
        Material { name: name.to_owned(), ..Material::grey() }
    }

    /// Adds the materials in a file.
    fn add_file(&mut self, path: &Path) -> Result<(), SceneError> {
        let text = read_text(path)?;
        let mut current: Option<(String, Entry)> = None;
        for line in Lines::wavefront(path, &text, &["newmtl"]) {
            match (line.words[0], &mut current) {
                ("newmtl", _) => {
                    self.materials.extend(current);
                    let name = line.words[1..].join(" ");
                    let (material, unread) = (Material::grey(), BTreeSet::new());
                    let entry = Entry { material, is_white: false, unread };
                    current = Some((name, entry));
                }
                ("Kd", Some((_, entry))) => {
                    let whole = colour(&line)?;
                    let values = whole.map(|band| if band == 1.0 { WHITEST } else { band });
                    entry.is_white = values != whole;
                    entry.material.reflectance = values.to_vec();
                }
                ("Ke", Some((_, entry))) => entry.material.emission = colour(&line)?.to_vec(),
                (word, Some((_, entry))) => entry.unread.extend(unread(word, &line)),
                (_, None) => (),
            }
        }
        self.materials.extend(current);
        Ok(())
    }
}

/// What a line says of a material that changes how much light it gives back, lets through or emits, and isn't read.
fn unread(word: &str, line: &Line) -> Option<&'static str> {
    let value = || line.words.last().and_then(|value| value.parse::<f64>().ok());
    match word {
        "map_Kd" => {
            Some("its texture of colours is not read, `Kd` beside it taken for the reflectance")
        }
        "map_Ke" => {
            Some("its texture of emission is not read, `Ke` beside it taken for the emission")
        }
        "d" if value().is_some_and(|opacity| opacity < 1.0) => Some(TRANSPARENT),
        "Tr" if value().is_some_and(|transparency| transparency > 0.0) => Some(TRANSPARENT),
        "map_d" => Some(TRANSPARENT),
        _ => None,
    }
}

/// What is said of a material through which light passes.
const TRANSPARENT: &str = "light passes through it, which is not read: taken to be opaque";

/// The three numbers of a line, or its only one three times.
fn colour(line: &Line) -> Result<[f64; 3], SceneError> {
    let [_, grey] = *line.words else { return line.numbers(1) };
    let grey = grey.parse().ok().filter(|grey: &f64| grey.is_finite());
    let refusal = || line.refusal(format!("one or three finite numbers, found {}", line.quoted()));
    grey.map(|grey| [grey; 3]).ok_or_else(refusal)
}

/// The names of files in the words after `mtllib`: as many words in one as a file is named, quoted or
/// not, up to a comment.
fn names(folder: &Path, words: &[&str]) -> Vec<String> {
    let mut names = Vec::new();
    let mut rest = words;
    while !rest.is_empty() {
        let joined = |count: usize| rest[..count].join(" ");
        let found = (1..=rest.len()).rev().find(|&count| find(folder, &joined(count)).is_some());
        let count = match found {
            Some(count) => count,
            None if rest[0].starts_with('#') => break,
            // Of what isn't there, a name ends as those of such files do.
            None => {
                let ends = |word: &&str| unquoted(word).to_lowercase().ends_with(".mtl");
                rest.iter().position(ends).map_or(rest.len(), |last| last + 1)
            }
        };
        names.push(joined(count));
        rest = &rest[count..];
    }
    names
}

/// The file of a name, which may be quoted and have back slashes between folders.
fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = unquoted(name);
    let candidates = [folder.join(name), folder.join(name.replace('\\', "/"))];
    candidates.into_iter().find(|path| path.is_file())
}

/// A name without the quotes around it.
fn unquoted(name: &str) -> &str {
    name.trim_matches(['"', '\''])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// A library of files in a folder of their own, as the words after `mtllib` name them.
    fn library(files: &[(&str, &str)], words: &str) -> Result<Library, SceneError> {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().expect("below")).expect("made");
            fs::write(path, text).expect("written");
        }
        let mut library = Library::default();
        let words: Vec<_> = words.split_whitespace().collect();
        library.read(folder.path(), &words).map(|()| library)
    }

    fn reflectance(library: &mut Library, name: &str) -> Vec<f64> {
        library.material(name).reflectance
    }

    #[test]
    fn files_are_found_by_all_the_ways_to_name_them() {
        let files = [
            ("a.mtl", "newmtl a\nKd .1 .1 .1"),
            ("b c.mtl", "newmtl b\nKd .2 .2 .2"),
            ("sub/d.mtl", "newmtl d\nKd .3 .3 .3"),
        ];
        for (words, found, missing) in [
            ("a.mtl", "a", ""),
            ("b c.mtl", "b", ""),
            ("\"b c.mtl\" a.mtl", "ab", ""),
            ("a.mtl b c.mtl sub/d.mtl", "abd", ""),
            ("sub\\d.mtl 'a.mtl' # and more", "ad", ""),
            (
                "x y.mtl a.mtl z",
                "a",
                "material file `x y.mtl` not found; material file `z` not found",
            ),
        ] {
            let mut library = library(&files, words).expect("valid");
            assert_eq!(library.missing.join("; "), missing, "{words}");
            for (name, value) in [("a", 0.1), ("b", 0.2), ("d", 0.3)] {
                let expected = if found.contains(name) { value } else { 0.5 };
                assert_eq!(reflectance(&mut library, name), [expected; 3], "{words}: {name}");
            }
        }
    }

    #[test]
    fn signs_in_names_and_comments_after_them_are_told_apart() {
        let text = "newmtl Material #1\nKd .1 .1 .1 # dark\nnewmtl Material #2\n#Kd 0 0 0\n\
            Kd .9 .9 .9\nnewmtl wall # white\nKd .8\n";
        let mut library = library(&[("a.mtl", text)], "a.mtl").expect("valid");
        for (name, value) in
            [("Material #1", 0.1), ("Material #2", 0.9), ("wall", 0.8), ("wall # white", 0.8)]
        {
            assert_eq!(reflectance(&mut library, name), [value; 3], "{name}");
        }
        assert!(library.missing.is_empty());
        assert_eq!(reflectance(&mut library, "Material #3"), [0.5; 3]);
        assert_eq!(library.missing, ["material `Material #3` not found, faces made grey"]);
    }

    #[test]
    fn a_material_that_reflects_everything_reflects_nearly_everything() {
        let text = "newmtl white\nKd 1 1.0 0.5\nnewmtl grey\nKd 0.5\nnewmtl bright\nKd 255 0 0\n";
        let mut library = library(&[("a.mtl", text)], "a.mtl").expect("valid");
        assert_eq!(reflectance(&mut library, "grey"), [0.5; 3]);
        assert!(library.repairs.is_empty(), "only what is in use is said");
        assert_eq!(reflectance(&mut library, "white"), [0.999, 0.999, 0.5]);
        assert_eq!(library.repairs, ["material `white` reflects everything, taken for 0.999"]);
        assert!(library.material("bright").check(3).is_err());
    }

    #[test]
    fn textures_and_transparency_are_said_of_what_is_in_use() {
        let text = "newmtl wood\nKd 1 1 1\nmap_Kd -s 1 1 1 wood.png\nd 1\nTr 0\nnewmtl glass\nKd .1 .1 .1\n\
            d 0.2\nTr 0.8\nmap_d holes.png\nnewmtl lamp\nKe 1 1 1\nmap_Ke glow.png\nnewmtl plain\nKs 1 1 1\n";
        let mut library = library(&[("a.mtl", text)], "a.mtl").expect("valid");
        reflectance(&mut library, "plain");
        assert!(library.missing.is_empty(), "only what is in use is said");
        for (name, what) in [
            ("wood", "its texture of colours is not read"),
            ("glass", "light passes through it"),
            ("lamp", "its texture of emission is not read"),
        ] {
            reflectance(&mut library, name);
            let [said] = &library.missing[..] else { panic!("{name}: {:?}", library.missing) };
            assert!(said.starts_with(&format!("material `{name}`: {what}")), "{said}");
            library.missing.clear();
        }
    }

    #[test]
    fn numbers_that_are_none_are_refused_at_the_line() {
        for (kd, expected) in [
            ("Kd x", "line 2: expected one or three finite numbers, found `Kd x`"),
            ("Kd nan", "line 2: expected one or three finite numbers, found `Kd nan`"),
            ("Kd .5 .5", "line 2: expected three finite numbers, found `Kd .5 .5`"),
            ("Kd", "line 2: expected three finite numbers, found `Kd`"),
        ] {
            let refused = library(&[("a.mtl", &format!("newmtl a\n{kd}\n"))], "a.mtl");
            let message = refused.expect_err(kd).to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
