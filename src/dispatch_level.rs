//! Which of the processor's instructions are used, and how to use fewer.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use pulp::{Arch, WithSimd};

/// A set of processor instructions that inner loops are compiled for; a later one has wider registers.
///
/// Every inner loop is compiled once for each level of the processor's family, and the widest level
/// that the processor has is chosen at run time. The environment variable `FARFIELD_DISPATCH` caps the
/// choice. Its value is the name of a level, as [`Display`](fmt::Display) writes it: `portable`, `neon`,
/// `avx2` or `avx512`. It is read once, when the first plan is built or the first sum is formed, and
/// holds for the whole process. If the processor lacks the level named, the widest level below it is used.
///
/// Levels round differently, so results have the same bits only on the same level. A cap shows on one
/// machine what another machine would compute:
///
/// ```sh
/// FARFIELD_DISPATCH=portable cargo test
/// ```
///
/// The cap does not reach `faer`, which factorises and multiplies dense matrices while a plan is built
/// and chooses its instructions itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum DispatchLevel {
    /// The instructions that the build assumes of every processor: SSE2 on x86-64.
    Portable,
    /// NEON on ARM, and whatever `pulp` knows of other processors outside the x86 family.
    Neon,
    /// AVX2 and FMA: registers of 256 bits.
    Avx2,
    /// AVX-512 with its F, BW, CD, DQ and VL parts: registers of 512 bits.
    Avx512,
}

/// The environment variable that caps the level.
const VARIABLE: &str = "FARFIELD_DISPATCH";

impl DispatchLevel {
    const ALL: [Self; 4] = [Self::Portable, Self::Neon, Self::Avx2, Self::Avx512];

    /// The level in force: the widest that the processor has and `FARFIELD_DISPATCH` allows.
    ///
    /// # Errors
    /// [`UnknownDispatchLevel`] if `FARFIELD_DISPATCH` is set and does not name a level.
    /// [`Builder::build`](crate::Builder::build) passes it on.
    pub fn in_force() -> Result<Self, UnknownDispatchLevel> {
        chosen().map(Self::of).map_err(Clone::clone)
    }

    /// The levels that this processor has, narrowest first, whatever the cap.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|&level| Self::of(level.arch()) == level)
    }

    /// Runs an operation compiled for this level, or for the widest level below it that the processor has.
    ///
    /// Use [`dispatch`] instead except to compare levels.
    #[inline(always)]
    pub fn run<Op: WithSimd>(self, op: Op) -> Op::Output {
        self.arch().dispatch(op)
    }

    /// The widest instructions that the processor has and that are no wider than this level.
    #[inline]
    fn arch(self) -> Arch {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            if self >= Self::Avx512
                && let Some(avx512) = pulp::x86::V4::try_new()
            {
                return Arch::V4(avx512);
            }
            if self >= Self::Avx2
                && let Some(avx2) = pulp::x86::V3::try_new()
            {
                return Arch::V3(avx2);
            }
        }
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        if self >= Self::Neon {
            return Arch::new();
        }
        Arch::Scalar
    }

    fn of(arch: Arch) -> Self {
        match arch {
            Arch::Scalar => Self::Portable,
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Arch::V3(_) => Self::Avx2,
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Arch::V4(_) => Self::Avx512,
            _ => Self::Neon,
        }
    }
}

impl fmt::Display for DispatchLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Portable => "portable",
            Self::Neon => "neon",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        })
    }
}

impl FromStr for DispatchLevel {
    type Err = UnknownDispatchLevel;

    fn from_str(name: &str) -> Result<Self, UnknownDispatchLevel> {
        let named = Self::ALL.into_iter().find(|level| level.to_string() == name);
        named.ok_or_else(|| UnknownDispatchLevel { found: name.into() })
    }
}

/// The value of `FARFIELD_DISPATCH` does not name a [`DispatchLevel`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{VARIABLE} is {found:?}: expected portable, neon, avx2 or avx512")]
#[non_exhaustive]
pub struct UnknownDispatchLevel {
    /// The value.
    pub found: String,
}

/// Runs an operation compiled for the [level in force](DispatchLevel::in_force).
///
/// This is how the engine enters every loop that is compiled for wide registers. A kernel with a loop of
/// its own, written for `pulp`, should enter it this way too, so that it obeys the same cap.
///
/// # Panics
/// If `FARFIELD_DISPATCH` does not name a level. A plan that was built has ruled this out.
#[inline(always)]
pub fn dispatch<Op: WithSimd>(op: Op) -> Op::Output {
    allowed().dispatch(op)
}

/// [`dispatch`] for operations to which wider registers than those of AVX2 bring nothing: they are not
/// compiled for more.
#[inline(always)]
pub(crate) fn dispatch_up_to_avx2<Op: WithSimd>(op: Op) -> Op::Output {
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    match allowed() {
        Arch::V4(avx512) => pulp::Simd::vectorize(*avx512, op),
        Arch::V3(avx2) => pulp::Simd::vectorize(avx2, op),
        _ => pulp::Simd::vectorize(pulp::Scalar, op),
    }
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    allowed().dispatch(op)
}

/// Does `work` that may leave the upper halves of wide registers in use, and clears them.
///
/// Code for narrow registers, such as a user's closure, runs up to sixty times slower on a thread whose upper
/// halves are in use. Compilers clear them wherever wide code ends; the products of `faer` are written by
/// hand, and don't.
#[inline(always)]
pub(crate) fn leaving_registers_clean<R>(work: impl FnOnce() -> R) -> R {
    let result = work();
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    if let Some(avx) = pulp::core_arch::x86::Avx::try_new() {
        avx._mm256_zeroupper();
    }
    result
}

/// The instructions in force.
#[inline]
fn allowed() -> Arch {
    chosen().unwrap_or_else(|error| panic!("{error}"))
}

/// The instructions in force, found out by the first call. All others cost one atomic load.
#[inline]
fn chosen() -> Result<Arch, &'static UnknownDispatchLevel> {
    static CHOSEN: OnceLock<Result<Arch, UnknownDispatchLevel>> = OnceLock::new();
    let choose = || {
        let named = std::env::var_os(VARIABLE).map(|name| name.to_string_lossy().parse());
        named.unwrap_or(Ok(DispatchLevel::Avx512)).map(DispatchLevel::arch)
    };
    CHOSEN.get_or_init(choose).as_ref().map(|&arch| arch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Error, Fmm, from_fn};
    use glam::DVec3;
    use pulp::Simd;
    use std::process::Command;

    /// How many numbers of single precision a register holds.
    struct Width;

    impl WithSimd for Width {
        type Output = usize;

        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }

    #[test]
    fn levels_are_written_and_read_alike_and_others_are_refused() {
        for level in DispatchLevel::ALL {
            assert_eq!(level.to_string().parse(), Ok(level));
        }
        for name in ["", "AVX2", "avx-512", "sse", "avx2 "] {
            let error = UnknownDispatchLevel { found: name.into() };
            assert_eq!(name.parse::<DispatchLevel>(), Err(error.clone()));
            assert!(error.to_string().contains("portable, neon, avx2 or avx512"), "{error}");
        }
    }

    #[test]
    fn a_level_runs_in_registers_of_its_width() {
        let available: Vec<_> = DispatchLevel::available().collect();
        assert_eq!(available[0], DispatchLevel::Portable);
        for level in DispatchLevel::ALL {
            let widest = available.iter().rev().find(|&&has| has <= level).unwrap();
            assert_eq!(level.run(Width), widest.run(Width));
        }
        assert!(available.is_sorted_by(|a, b| a < b && a.run(Width) < b.run(Width)));
        for (level, width) in [(DispatchLevel::Avx2, 8), (DispatchLevel::Avx512, 16)] {
            assert!(!available.contains(&level) || level.run(Width) == width);
        }
    }

    /// Also run by [`the_environment_caps_the_level_and_has_to_name_one`], with every cap.
    #[test]
    fn loops_run_at_the_level_in_force() {
        let width = dispatch(Width);
        let level = DispatchLevel::in_force().unwrap();
        assert_eq!(width, level.run(Width));
        let cap =
            std::env::var(VARIABLE).map_or(DispatchLevel::Avx512, |name| name.parse().unwrap());
        assert_eq!(Some(level), DispatchLevel::available().filter(|&has| has <= cap).last());
    }

    /// Also run by [`the_environment_caps_the_level_and_has_to_name_one`], with what is no level.
    #[test]
    fn plans_are_refused_where_the_level_is_unknown() {
        let kernel = from_fn(|x: DVec3, y: DVec3| x.distance(y));
        let built = Fmm::builder(kernel).build(&[DVec3::ZERO], &[DVec3::ONE]);
        assert_eq!(built.err(), DispatchLevel::in_force().err().map(Error::from));
    }

    /// The variable is read once in a process, so each value is tried in a process of its own.
    #[test]
    fn the_environment_caps_the_level_and_has_to_name_one() {
        let run = |test: &str, cap: &str| {
            let (_, module) = module_path!().split_once("::").unwrap();
            let this = std::env::current_exe().unwrap();
            let test = format!("{module}::{test}");
            let output = Command::new(this).args(["--exact", &test]).env(VARIABLE, cap).output();
            let output = output.unwrap();
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(text.contains("running 1 test"), "{text}");
            (output.status.success(), text)
        };
        for level in DispatchLevel::ALL {
            let (runs, text) = run("loops_run_at_the_level_in_force", &level.to_string());
            assert!(runs, "{text}");
        }
        let (runs, text) = run("loops_run_at_the_level_in_force", "sse9");
        let message = UnknownDispatchLevel { found: "sse9".into() }.to_string();
        assert!(!runs && text.contains(&message), "{text}");
        let (runs, text) = run("plans_are_refused_where_the_level_is_unknown", "sse9");
        assert!(runs, "{text}");
    }
}
