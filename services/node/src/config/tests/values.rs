//! What a file may say, and what comes of it.

use super::super::Layers;
use super::{Box, Config, Drive, Limit, Name, Wheel, layer};

#[test]
fn an_empty_file_or_no_file_leaves_the_defaults() {
    assert_eq!(Layers::new().parse(), Ok(Config::default()));
    for text in ["", "\n", "\u{feff}", "# nothing\r\n"] {
        assert_eq!(layer(text).parse(), Ok(Config::default()), "{text:?}");
    }
}

#[test]
fn every_type_is_read() {
    let text = r#"
        proportional_gain = 2
        speed_max_m_s = 0.5
        seed = 0xffff_ffff_ffff_ffff
        offset = -7
        name = "Grüße"
        label = '2024'
        enabled = false
        limit = "scale-down"
        gains = [1, 2.5]
        pose = [1, 2, 3]
        drive.wheel.radius = 0.033

        [[boxes]]
        width = 1
        height = 2.0
        name = "first"

        [[boxes]]
        width = 3
        height = 4
        name = "second"
    "#;
    let boxed = |width, height, name: &str| Box { width, height, name: Name(name.to_owned()) };

    assert_eq!(
        layer(text).parse(),
        Ok(Config {
            proportional_gain: 2.0,
            speed_max_m_s: 0.5,
            seed: u64::MAX,
            retries: 3,
            offset: -7,
            name: "Grüße".to_owned(),
            label: Some("2024".to_owned()),
            enabled: false,
            limit: Limit::ScaleDown,
            drive: Drive { period_ms: 50, wheel: Wheel { radius: 0.033 } },
            gains: vec![1.0, 2.5],
            pose: [1.0, 2.0, 3.0],
            boxes: vec![boxed(1.0, 2.0, "first"), boxed(3.0, 4.0, "second")],
        })
    );
}

/// Whatever is written, the answer is a configuration or errors, and never a panic.
#[test]
fn no_text_is_too_strange() {
    let seed = 42_u64;
    let mut state = seed;
    let mut next = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        usize::try_from(state >> 33).unwrap() % below
    };
    let pieces = [
        "seed",
        "drive",
        "boxes",
        "name",
        "pose",
        "gains",
        "limit",
        "=",
        "=",
        ".",
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        ",",
        "\n",
        "\n",
        "\r\n",
        " ",
        "'",
        "\"",
        "\"\"\"",
        "é",
        "\u{1f916}",
        "1",
        "-",
        "nan",
        "true",
        "#",
        "\\",
        "\0",
        "seed = 1\n",
        "[drive]\n",
        "[[boxes]]\n",
        "pose = [1, 'a']\n",
        "boxes = [{}]\n",
        "limit = {hold = 1}\n",
    ];
    for run in 0..20_000 {
        let text: String = (0..next(20)).map(|_| pieces[next(pieces.len())]).collect();
        if let Err(errors) = layer(&text).parse::<Config>() {
            assert!(!errors.is_empty(), "SEED={seed} run {run}: {text:?}");
            assert!(!errors.to_string().is_empty());
        }
    }
}
