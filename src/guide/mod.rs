//! A guide to fast multipole sums, from the idea to the last knob.
//!
//! | page | what it answers |
//! |---|---|
//! | [`method`] | Why can a sum over all pairs be fast? What are the tree, the lists, the five operators? |
//! | [`accuracy`] | What does a tolerance promise, what can't it promise, which one do I ask for? |
//! | [`kernels`] | How do I write a kernel: a formula, a closure, points with attributes, vectors? |
//! | [`expansions`] | How do I bring an expansion of my own? |
//! | [`masks`] | How do I leave pairs out? |
//! | [`plans`] | What does a plan cost, what does its report say, what can be chosen? |
//! | [`light`] | How does light between surfaces become such a sum? |
//! | [`references`] | Where does it all come from? |
//!
//! Every block of code on these pages is compiled and run by `cargo test --doc`. `python3 docs/figures.py` draws the
//! figures.

#[doc = include_str!("method_lists.md")]
#[doc = "<div>\n"]
#[doc = include_str!("lists.svg")]
#[doc = "</div>\n"]
#[doc = ""]
#[doc = include_str!("method_passes.md")]
#[doc = "<div>\n"]
#[doc = include_str!("passes.svg")]
#[doc = "</div>\n"]
#[doc = ""]
#[doc = include_str!("method_cost.md")]
pub mod method {}

#[doc = include_str!("accuracy.md")]
pub mod accuracy {}

#[doc = include_str!("kernels.md")]
pub mod kernels {}

#[doc = include_str!("expansions.md")]
pub mod expansions {}

#[doc = include_str!("masks.md")]
pub mod masks {}

#[doc = include_str!("plans.md")]
pub mod plans {}

#[doc = include_str!("light.md")]
pub mod light {}

#[doc = include_str!("references.md")]
pub mod references {}
