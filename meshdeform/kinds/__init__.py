"""Further kinds of job, one folder for each, which is all that there is of them.

Nothing outside a folder names it or imports it, but its tests and what trains it. It is found by
`meshdeform.requests.kind_folders`, and brings what it has in modules of these names. `NAMES` of the package itself are
those of its kinds of job, maybe none: it may bring commands and routes alone.

* `params`: `PARAMS`, the models of the parameters by kind; and `RETIRED`, names of those that stored requests may have.
  It imports `meshdeform.requests` alone, as the record does.
* `description`: `KINDS`, a `runs.base.Kind` of each: files, check, artifacts, and where the run is; and `COSTS` of the
  jobs, as `runs.costs` has them. Torch-free.
* `contents`: `READERS`, the checks of its files by what they hold (`FileField.content`), in the child that decodes
  them.
* `child_tasks`: `TASKS` of child processes, as `meshdeform.children.tasks` has them.
* `commands`: `COMMANDS` and `GROUPS` of the command line; `PRINTED`, how a result becomes a summary and lines, by kind;
  `OUTPUTS`, the artifacts that `--output` may name, by kind and ending, the first of which is always written; and
  `WORD_SOURCES`, pairs that tell whether a path has meshes for words of one's own, and make these meshes.
* `routes`: `ROUTERS` of the service, with `MODELS` and `TAGS` of their description.
"""
