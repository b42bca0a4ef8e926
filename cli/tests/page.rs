//! scene.html and report.html in a real browser: Chromium without a window, where there is one.

#![cfg(unix)]

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Edges of the browser's window, and of the square in its middle in which a scene's camera sees.
const WINDOW: [usize; 2] = [1200, 800];
const SQUARE: usize = 800;
/// The square's left edge.
const LEFT: usize = (WINDOW[0] - SQUARE) / 2;

/// A browser; without one, a message.
fn browser() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome", "chrome"];
    let found = std::env::split_paths(&folders)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|path| path.is_file());
    if found.is_none() {
        println!("left out: there is no chromium here to look at pages with");
    }
    found
}

/// Opens a page with some more options; returns what the browser says on standard output. Panics if the page's
/// console has anything to say.
fn open(browser: &Path, page: &Path, fragment: &str, options: &[&str]) -> String {
    let profile = tempfile::tempdir().expect("a folder");
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--disable-gpu-sandbox", "--use-gl=angle"])
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"])
        .args(["--force-device-scale-factor=1", "--virtual-time-budget=4000"])
        .args(["--enable-logging=stderr", "--no-first-run", "--disable-extensions"])
        .arg(format!("--window-size={},{}", WINDOW[0], WINDOW[1]))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(options)
        .arg(format!("file://{}{fragment}", page.display()))
        .output()
        .expect("the browser runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let console: Vec<_> = said.lines().filter(|line| line.contains(":CONSOLE")).collect();
    assert!(console.is_empty(), "{console:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A picture: columns, rows, and colours row by row.
struct Pixels {
    size: [usize; 2],
    codes: Vec<[u8; 3]>,
}

impl Pixels {
    fn read(path: &Path) -> Self {
        let file = std::io::BufReader::new(fs::File::open(path).expect("there"));
        let mut reader = png::Decoder::new(file).read_info().expect("PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("it fits")];
        let info = reader.next_frame(&mut bytes).expect("PNG");
        let channels = info.color_type.samples();
        let codes = bytes[..info.buffer_size()].chunks_exact(channels).map(|c| [c[0], c[1], c[2]]);
        Self { size: [info.width as usize, info.height as usize], codes: codes.collect() }
    }

    /// A page as a browser shows it.
    fn of_page(browser: &Path, page: &Path, fragment: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("shot.png");
        open(browser, page, fragment, &[&format!("--screenshot={}", path.display())]);
        Self::read(&path)
    }

    fn at(&self, x: usize, y: usize) -> [u8; 3] {
        self.codes[y * self.size[0] + x]
    }

    /// The mean colour of a rectangle.
    fn mean(&self, [left, right]: [usize; 2], [top, bottom]: [usize; 2]) -> [f64; 3] {
        let count = ((right - left) * (bottom - top)) as f64;
        let places = (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y)));
        places.fold([0.0; 3], |sum, (x, y)| {
            let code = self.at(x, y);
            std::array::from_fn(|band| sum[band] + f64::from(code[band]) / count)
        })
    }
}

/// Runs the program; its files are in the folder `out` of the one returned.
fn run(arguments: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let output = Command::new(env!("CARGO_BIN_EXE_farfield"))
        .args(["radiosity", "--quiet", "--out"])
        .arg(folder.path().join("out"))
        .args(arguments.split_whitespace())
        .output()
        .expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    folder
}

#[test]
fn a_page_shows_the_cornell_box_as_its_picture_does() {
    let Some(browser) = browser() else { return };
    let folder = run(&format!("--elements 3000 --size {SQUARE}x{SQUARE}"));
    let out = folder.path().join("out");
    let page = Pixels::of_page(&browser, &out.join("scene.html"), "");
    assert_eq!(page.size, WINDOW);
    let picture = Pixels::read(&out.join("radiosity.png"));

    // Red on the left, green on the right.
    let [r, g, b] = page.mean([LEFT + 50, LEFT + 90], [380, 420]);
    assert!(r > 60.0 && r > 2.0 * g && r > 2.0 * b, "{r} {g} {b}");
    let [r, g, b] = page.mean([LEFT + 710, LEFT + 750], [380, 420]);
    assert!(g > 60.0 && g > 1.2 * r && g > 2.0 * b, "{r} {g} {b}");

    // Within the box, beside the controls, it is the picture, but for shadows that elements make softer.
    let places: Vec<_> = (30..770).flat_map(|y| (60..770).map(move |x| (x, y))).collect();
    let apart = |&(x, y): &(usize, usize)| {
        let (found, expected) = (page.at(LEFT + x, y), picture.at(x, y));
        (0..3).map(|k| f64::from(found[k].abs_diff(expected[k]))).sum::<f64>() / 3.0
    };
    let mean = places.iter().map(apart).sum::<f64>() / places.len() as f64;
    let colours: HashSet<_> = places.iter().map(|&(x, y)| page.at(LEFT + x, y)).collect();
    println!("{mean} of 255 apart, {} colours", colours.len());
    assert!(mean < 2.5 && colours.len() > 1000, "{mean} {}", colours.len());
}

#[test]
fn a_page_tells_about_elements_and_shows_numbers_on_a_scale() {
    let Some(browser) = browser() else { return };
    let folder = run("--elements 1000 --size 64x64");
    let page = folder.path().join("out/scene.html");
    let at = "#show=irradiance&band=0&lines&at=0.27,0.5";
    let text = open(&browser, &page, at, &["--dump-dom"]);
    let card = text.split("<tbody id=\"numbers\">").nth(1).expect("a table");
    let card = card.split("</tbody>").next().expect("its end");
    for expected in [">Material</th><td colspan=\"6\">red</td>", "Radiosity B [W/m²]", ">Surface<"]
    {
        assert!(card.contains(expected), "{expected}: {card}");
    }
    let shot = Pixels::of_page(&browser, &page, at);
    // The scale at the right: pale at its upper end, nearly black at its lower one.
    let bar = |y: usize| shot.at(WINDOW[0] - 32, y).map(u32::from).iter().sum::<u32>();
    let bars: Vec<u32> = (70..400).step_by(30).map(bar).collect();
    assert!(bars[0] > 500 && bars[10] < 150 && bars.is_sorted_by(|a, b| a >= b), "{bars:?}");
    // Without light there are no walls in their own colours.
    let [r, g, _] = shot.mean([LEFT + 710, LEFT + 750], [380, 420]);
    assert!(g <= r, "{r} {g}");
}

#[test]
fn a_report_is_a_page_of_its_own() {
    let Some(browser) = browser() else { return };
    let folder = run("--elements 1000 --size 64x64");
    let page = folder.path().join("out/report.html");
    let text = open(&browser, &page, "", &["--dump-dom"]);
    for expected in ["<h2>Convergence</h2><svg", "<h2>Sums of form factors</h2><svg", "solving"] {
        assert!(text.contains(expected), "{expected}");
    }
}
