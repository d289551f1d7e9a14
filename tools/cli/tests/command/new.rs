//! `stillpoint new`: what it writes checks and runs as it is.

use crate::{root, stillpoint, text};

fn data(name: &str) -> String {
    root().join("examples/data").canonicalize().unwrap().join(name).display().to_string()
}

#[test]
fn a_new_rig_has_a_key_of_its_own_and_runs() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    for name in ["mine", "yours-2"] {
        let out = stillpoint(folder.path(), &["new", name]);
        assert!(out.status.success(), "{}", text(&out.stderr));
        let key = folder.path().join(name).join("rig.key");
        assert_eq!(key.metadata().unwrap().permissions().mode() & 0o777, 0o600);
        let written = std::fs::read_to_string(folder.path().join(name).join("pipeline.yaml")).unwrap();
        assert!(
            written.contains(&format!("\nname: {name}\n")) && !written.contains("examples/"),
            "{written}"
        );
        assert!(
            !written.contains("public") && written.contains("\n# The dissertation's system"),
            "{written}"
        );
        assert!(written.starts_with("# yaml-language-server: $schema=pipeline.schema.json\n"), "{written}");
        let schema = std::fs::read(folder.path().join(name).join("pipeline.schema.json")).unwrap();
        assert_eq!(schema, stillpoint(folder.path(), &["schema"]).stdout);
        let run = ["run", "--clock", "simulated", "--for", "1s", "--record", "s"];
        let out = stillpoint(&folder.path().join(name), &run);
        assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
        let replay = stillpoint(&folder.path().join(name), &["replay", &format!("s/{name}-0001")]);
        assert!(replay.status.success(), "{}{}", text(&replay.stdout), text(&replay.stderr));
    }
    let key = |name: &str| std::fs::read_to_string(folder.path().join(name).join("rig.key")).unwrap();
    assert_ne!(key("mine"), key("yours-2"));
    assert_eq!(key("mine").trim().len(), 64);
}

#[test]
fn new_pipelines_read_recordings_to_their_end() {
    let folder = tempfile::tempdir().unwrap();
    for (name, files, topic) in [
        ("images", data("depth/*.png"), None),
        ("clouds", data("clouds/*.pcd"), None),
        ("bag", data("clouds.mcap"), Some("coarse.cloud")),
    ] {
        let topic: Vec<&str> = topic.iter().flat_map(|topic| ["--topic", topic]).collect();
        let out = stillpoint(folder.path(), &[&["new", name, "--files", &files][..], &topic].concat());
        assert!(out.status.success(), "{}", text(&out.stderr));
        let at = folder.path().join(name);
        let out = stillpoint(&at, &["run", "pipeline.yaml", "--clock", "simulated", "--no-record", "--json"]);
        assert!(out.status.success(), "{name}: {}{}", text(&out.stdout), text(&out.stderr));
        let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let sent = |operator: &str| {
            let all = report["operators"].as_array().unwrap();
            all.iter().find(|o| o["operator"] == operator).unwrap()["sent"].as_u64().unwrap()
        };
        assert!(sent("cloud") >= 2, "{name}: {report}");
    }
}

#[test]
fn a_new_pipeline_for_ros_2_passes_the_check() {
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &["new", "ros", "--camera", "/azure/depth"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let written = std::fs::read_to_string(folder.path().join("ros/pipeline.yaml")).unwrap();
    assert!(written.contains("topic: \"/azure/depth\"") && !written.contains("recording"), "{written}");
    let check = stillpoint(&folder.path().join("ros"), &["check"]);
    assert!(check.status.success(), "{}", text(&check.stderr));
}

#[test]
fn what_would_not_check_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("there")).unwrap();
    for (arguments, code, word) in [
        (&["new", "Mine"][..], 2, "invalid name `Mine`"),
        (&["new", "../up"], 2, "invalid name"),
        (&["new", "there"], 1, "it exists"),
        (&["new", "none", "--files", "nothing/*.png"], 2, "nothing was written"),
        (&["new", "none", "--files", "ride.mcap"], 2, "add `--topic TOPIC`"),
        (&["new", "none", "--files", "a.png", "--topic", "/a"], 2, "remove --topic"),
        (&["new", "none", "--files", "a.bmp"], 2, "unknown kind of recording"),
        (&["new", "none", "--topic", "/a"], 2, "--files"),
    ] {
        let out = stillpoint(folder.path(), arguments);
        assert_eq!(out.status.code(), Some(code), "{arguments:?}: {}", text(&out.stderr));
        assert!(text(&out.stderr).contains(word), "{arguments:?}: {}", text(&out.stderr));
        assert!(!folder.path().join("none").exists());
    }
}

#[test]
fn a_new_operator_is_a_crate_that_depends_on_one_library() {
    let folder = tempfile::tempdir().unwrap();
    let sources = root().canonicalize().unwrap().display().to_string();
    let out = stillpoint(folder.path(), &["new", "operator", "my-filter", "--stillpoint", &sources]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let read = |file: &str| std::fs::read_to_string(folder.path().join("my-filter").join(file)).unwrap();
    let cargo = read("Cargo.toml");
    assert!(
        cargo.contains(&format!("stillpoint-operator = {{ path = \"{sources}/pipeline/operator\" }}")),
        "{cargo}"
    );
    assert_eq!(cargo.matches("path = ").count(), 1, "{cargo}");
    // Tests compile and test the template as it is but for the names.
    let template =
        std::fs::read_to_string(root().join("tools/cli/src/commands/new/crate_of_operator/main.rs")).unwrap();
    let main = read("src/main.rs");
    assert_eq!(main, template.replace("my.KIND", "my.my_filter").replace("NAME", "my-filter"));
    assert!(read("pipeline.yaml").contains("use: { program: target/release/my-filter, kind: my.my_filter }"));
    let check = stillpoint(&folder.path().join("my-filter"), &["check"]);
    assert_eq!(check.status.code(), Some(2));
    let message = text(&check.stderr);
    assert!(
        message.contains("pipeline.yaml:12:10: the program `target/release/my-filter` cannot be read"),
        "{message}"
    );
    assert!(message.contains("cargo build --release"), "{message}");

    let none = stillpoint(folder.path(), &["new", "operator", "other", "--stillpoint", "."]);
    assert_eq!(none.status.code(), Some(2));
    assert!(text(&none.stderr).contains("the sources of stillpoint are not there"), "{}", text(&none.stderr));
    assert!(!folder.path().join("other").exists());
}
