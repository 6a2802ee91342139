//! Notes which compiler builds the bench: part of every card.

#![forbid(unsafe_code)]

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let rustc = env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let said = Command::new(rustc).arg("--version").output();
    let version = said.ok().and_then(|said| String::from_utf8(said.stdout).ok());
    let version =
        version.as_deref().and_then(|text| text.lines().next()).unwrap_or("rustc unknown");
    println!("cargo::rustc-env=BENCH_RUSTC={version}");
}
