//! Dependencies have no cycles, and the diagrams in docs/architecture.md agree with the sources. With the environment variable
//! `UPDATE_DOCS` set, the test writes the diagrams instead of comparing them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// For each module or crate, the modules or crates that it uses.
type Graph = BTreeMap<String, BTreeSet<String>>;

const DOCUMENT: &str = "docs/architecture.md";
const BEGIN: &str = "<!-- The diagrams are generated: see CONTRIBUTING.md. -->\n";
const END: &str = "<!-- End of the generated diagrams. -->\n";

/// Folders with host programs and with tests. No firmware may use the crates in these folders.
const HOST: [&str; 6] = ["fuzz", "host-tests", "proofs", "python", "testkit", "tools"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The paths of all files with this ending below a folder of the workspace, relative to the root of the workspace. Hidden
/// folders, `node_modules` and `target` are skipped.
fn files(folder: &str, ending: &str) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(root().join(folder)).expect("the folder can be read").flatten() {
        let name = entry.file_name().into_string().expect("the name is UTF-8");
        let path = if folder.is_empty() { name.clone() } else { format!("{folder}/{name}") };
        if entry.path().is_dir() {
            let is_source = !name.starts_with('.') && !["node_modules", "target"].contains(&name.as_str());
            if is_source {
                found.extend(files(&path, ending));
            }
        } else if name.ends_with(ending) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Adds the dependency of `from` on `to`, unless both are the same.
fn add(graph: &mut Graph, from: &str, to: &str) {
    if from != to {
        graph.entry(from.into()).or_default().insert(to.into());
    }
}

/// Returns a cycle of the graph, if it has one.
fn cycle(graph: &Graph) -> Option<Vec<String>> {
    fn visit(graph: &Graph, node: &str, path: &mut Vec<String>, visited: &mut BTreeSet<String>) -> bool {
        if let Some(first) = path.iter().position(|on_path| on_path == node) {
            path.drain(..first);
            path.push(node.into());
            return true;
        }
        if !visited.insert(node.into()) {
            return false;
        }
        path.push(node.into());
        let found = graph.get(node).into_iter().flatten().any(|next| visit(graph, next, path, visited));
        if !found {
            path.pop();
        }
        found
    }
    let (mut path, mut visited) = (Vec::new(), BTreeSet::new());
    graph.keys().any(|start| visit(graph, start, &mut path, &mut visited)).then_some(path)
}

fn assert_no_cycle(graph: &Graph) {
    if let Some(cycle) = cycle(graph) {
        panic!("a cycle of dependencies: {}", cycle.join(" -> "));
    }
}

/// True if `to` can be reached from `from`.
fn reaches(graph: &Graph, from: &str, to: &str) -> bool {
    from == to || graph.get(from).into_iter().flatten().any(|next| reaches(graph, next, to))
}

/// The graph without the direct dependencies that other dependencies imply.
fn reduced(graph: &Graph) -> Graph {
    assert_no_cycle(graph);
    let is_implied =
        |uses: &BTreeSet<String>, to: &str| uses.iter().any(|other| other != to && reaches(graph, other, to));
    let direct = |uses: &BTreeSet<String>| uses.iter().filter(|to| !is_implied(uses, to)).cloned().collect();
    graph.iter().map(|(from, uses)| (from.clone(), direct(uses))).collect()
}

/// The paths within the library that a source uses: paths that begin with `crate`, `self` or `super`, with braces expanded. The
/// tests at the end of a file do not count.
fn used_paths(source: &str) -> Vec<Vec<String>> {
    let code = source.split("\n#[cfg(test)]").next().unwrap_or_default();
    let code: String = code.lines().map(|line| line.split("//").next().unwrap_or_default().to_owned() + "\n").collect();
    let mut paths = Vec::new();
    let mut parsed_until = 0;
    for (separator, _) in code.match_indices("::") {
        let start = code[..separator].trim_end_matches(is_identifier).len();
        if start >= parsed_until && ["crate", "self", "super"].contains(&&code[start..separator]) {
            let rest = parse_tree(&code[start..], &[], &mut paths);
            parsed_until = code.len() - rest.len();
        }
    }
    paths
}

fn is_identifier(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Adds the paths of a tree such as `a::{b, c::d}`, each after `prefix`; returns the text after the tree.
fn parse_tree<'t>(text: &'t str, prefix: &[String], paths: &mut Vec<Vec<String>>) -> &'t str {
    let mut path = prefix.to_vec();
    let mut rest = text.trim_start();
    loop {
        if let Some(mut list) = rest.strip_prefix('{') {
            loop {
                list = list.trim_start();
                if let Some(rest) = list.strip_prefix('}') {
                    return rest;
                }
                let after_item = parse_tree(list, &path, paths).trim_start();
                // The new name in `a as b` is ignored.
                let end = after_item.find([',', '}']).expect("an item has an end");
                list = after_item[end..].trim_start_matches(',');
            }
        }
        let length = rest.find(|c| !is_identifier(c)).unwrap_or(rest.len());
        path.push(rest[..length].to_owned());
        rest = &rest[length..];
        match rest.strip_prefix("::") {
            Some(next) if next.starts_with(|c| is_identifier(c) || c == '{') => rest = next,
            _ => {
                paths.push(path);
                return rest;
            }
        }
    }
}

/// The modules of the library.
struct Modules {
    /// The source of each module.
    files: BTreeMap<String, String>,
    /// For each item that a module exports from its submodules, the path of its definition.
    exports: BTreeMap<String, String>,
}

impl Modules {
    fn of_library() -> Self {
        let mut modules = Self { files: BTreeMap::new(), exports: BTreeMap::new() };
        for file in files("src", ".rs") {
            let path = file.trim_start_matches("src/").trim_end_matches(".rs").trim_end_matches("/mod");
            let name = if path == "lib" { String::new() } else { path.replace('/', "::") };
            modules.files.insert(name, read(&root().join(file)));
        }
        for (module, source) in &modules.files {
            for tree in source.split("\npub").filter_map(exported_tree) {
                let mut paths = Vec::new();
                parse_tree(tree, &[], &mut paths);
                for path in paths.iter().filter(|path| path.len() > 1) {
                    let name = [module.as_str(), &path[path.len() - 1]].join("::");
                    let path = [module.as_str(), &path.join("::")].join("::");
                    let path = path.trim_start_matches("::").to_owned();
                    modules.exports.insert(name.trim_start_matches("::").to_owned(), path);
                }
            }
        }
        modules
    }

    /// The module that defines the item with the path `path` in the module `user`.
    fn resolve(&self, user: &str, path: &[String]) -> String {
        let mut names: Vec<&str> = user.split("::").filter(|name| !name.is_empty()).collect();
        for name in path {
            match name.as_str() {
                "crate" => names.clear(),
                "self" => {}
                "super" => drop(names.pop()),
                name => names.push(name),
            }
        }
        let mut path = names.join("::");
        while let Some(origin) = self.exports.get(&path) {
            path = origin.clone();
        }
        while !self.files.contains_key(&path) {
            path = path.rsplit_once("::").map_or(String::new(), |(module, _)| module.into());
        }
        path
    }

    /// For each module, the modules that it uses. An item that a module only exports does not count as used.
    fn graph(&self) -> Graph {
        let mut graph = Graph::new();
        for (module, source) in self.files.iter().filter(|(module, _)| !module.is_empty()) {
            graph.entry(module.clone()).or_default();
            for path in used_paths(source) {
                let used = self.resolve(module, &path);
                assert!(!used.is_empty(), "{module} uses {}, which is in src/lib.rs or unknown", path.join("::"));
                add(&mut graph, module, &used);
            }
        }
        graph
    }
}

/// The tree of a `pub use` of submodules. `text` begins after the `pub`.
fn exported_tree(text: &str) -> Option<&str> {
    // `pub(crate)`, `pub(super)` or `pub(in path)`.
    let text = text.strip_prefix('(').and_then(|rest| rest.split_once(')')).map_or(text, |(_, text)| text);
    let text = text.strip_prefix(" use ")?;
    (!["crate::", "self::", "super::"].iter().any(|other| text.starts_with(other))).then_some(text)
}

/// For each top-level module, the top-level modules that it uses.
fn top_level(modules: &Graph) -> Graph {
    let top = |module: &str| module.split("::").next().unwrap_or_default().to_owned();
    let mut graph = Graph::new();
    for (module, uses) in modules {
        graph.entry(top(module)).or_default();
        uses.iter().for_each(|used| add(&mut graph, &top(module), &top(used)));
    }
    graph
}

/// The folder of each crate of the workspace, and the crates that each crate uses other than in its tests.
fn crates() -> (BTreeMap<String, String>, Graph) {
    let manifests = files("", "Cargo.toml").into_iter().filter(|file| file != "fuzz/Cargo.toml");
    let manifests: Vec<_> = manifests.map(|file| (read(&root().join(&file)), file)).collect();
    let name = |manifest: &str| {
        let name =
            manifest.lines().skip_while(|line| *line != "[package]").find_map(|line| line.strip_prefix("name = "));
        name.expect("the package has a name").trim_matches('"').to_owned()
    };
    let folders: BTreeMap<_, _> = manifests
        .iter()
        .map(|(manifest, file)| (name(manifest), file.trim_end_matches("Cargo.toml").trim_end_matches('/').to_owned()))
        .collect();
    let mut graph = Graph::new();
    for (manifest, _) in &manifests {
        let user = name(manifest);
        graph.entry(user.clone()).or_default();
        let mut is_list = false;
        for line in manifest.lines() {
            if line.starts_with('[') {
                // Lists of dependencies of the package, of its build script and of a target count; those of tests and of the
                // workspace do not.
                is_list = line.ends_with("dependencies]") && !line.contains("dev-") && !line.contains("workspace");
            }
            let used = line.split([' ', '.', '=']).next().unwrap_or_default();
            if is_list && folders.contains_key(used) {
                add(&mut graph, &user, used);
            }
        }
    }
    (folders, graph)
}

/// The first folder of a path.
fn first_folder(path: &str) -> &str {
    path.split('/').next().unwrap_or_default()
}

/// Writes the dependencies, without those that others imply, in Mermaid's notation.
fn write_edges(text: &mut String, graph: &Graph) {
    for (from, uses) in reduced(graph).iter().filter(|(_, uses)| !uses.is_empty()) {
        let uses = uses.iter().map(String::as_str).collect::<Vec<_>>().join(" & ");
        // Writing to a string cannot fail.
        let _ = writeln!(text, "    {from} --> {uses}");
    }
}

/// Both diagrams in Mermaid's notation.
fn diagrams(top: &Graph, folders: &BTreeMap<String, String>, crates: &Graph) -> String {
    let mut text = String::from("\nModules of `src`:\n\n```mermaid\nflowchart TD\n");
    write_edges(&mut text, top);
    text.push_str("```\n\nPackages of the workspace, by folder:\n\n```mermaid\nflowchart TD\n");
    let groups: BTreeSet<_> = folders.values().map(|folder| first_folder(folder)).collect();
    for group in
        groups.into_iter().filter(|group| folders.values().any(|folder| folder.starts_with(&format!("{group}/"))))
    {
        let _ = writeln!(text, "    subgraph {group}");
        for (name, folder) in folders.iter().filter(|(_, folder)| first_folder(folder) == group) {
            let label =
                if folder.ends_with(name.as_str()) { name.clone() } else { format!("{name}[\"{name} ({folder})\"]") };
            let _ = writeln!(text, "        {label}");
        }
        text.push_str("    end\n");
    }
    write_edges(&mut text, crates);
    text.push_str("```\n\n");
    text
}

#[test]
fn modules_have_no_import_cycle() {
    let modules = Modules::of_library().graph();
    assert_no_cycle(&top_level(&modules));
    assert_no_cycle(&modules);
}

#[test]
fn firmware_uses_no_host_program() {
    let (folders, graph) = crates();
    let is_host = |name: &str| HOST.contains(&first_folder(&folders[name]));
    for (user, uses) in graph.iter().filter(|(user, _)| !is_host(user)) {
        let wrong: Vec<_> = uses.iter().filter(|used| is_host(used)).collect();
        assert!(wrong.is_empty(), "{user} must not use {wrong:?}: these crates are for a host");
    }
    assert_no_cycle(&graph);
}

#[test]
fn the_diagrams_agree_with_the_sources() {
    let (folders, crates) = crates();
    let diagrams = diagrams(&top_level(&Modules::of_library().graph()), &folders, &crates);
    let path = root().join(DOCUMENT);
    let text = read(&path);
    let (before, rest) = text.split_once(BEGIN).unwrap_or_else(|| panic!("{DOCUMENT} must contain the line {BEGIN}"));
    let (written, after) = rest.split_once(END).unwrap_or_else(|| panic!("{DOCUMENT} must contain the line {END}"));
    if std::env::var_os("UPDATE_DOCS").is_some() {
        fs::write(&path, [before, BEGIN, &diagrams, END, after].concat()).expect("the document is written");
    } else {
        assert_eq!(written, diagrams, "run `UPDATE_DOCS=1 cargo test --release -p host-tests architecture::`");
    }
}

#[test]
fn a_cycle_is_found_and_named() {
    let mut graph = Graph::new();
    [("a", "b"), ("b", "c"), ("c", "d")].into_iter().for_each(|(from, to)| add(&mut graph, from, to));
    assert_eq!(cycle(&graph), None);
    add(&mut graph, "d", "b");
    assert_eq!(cycle(&graph), Some(["b", "c", "d", "b"].map(String::from).into()));
}

#[test]
fn used_paths_are_found_in_imports_and_in_code() {
    let source = "use core::fmt;\nuse super::{a, b::{self, C as D}};\n// use crate::not;\n\
                  fn f() -> crate::e::F {\n    super::g()\n}\n\
                  #[cfg(test)]\nmod tests {\n    use crate::not;\n}\n";
    let found: Vec<_> = used_paths(source).iter().map(|path| path.join("::")).collect();
    assert_eq!(found, ["super::a", "super::b::self", "super::b::C", "crate::e::F", "super::g"]);
}
