"""Sends the files of an agent to the Hugging Face hub, and fetches them. They are looked at before they are taken."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from huggingface_hub import HfApi, get_token
from huggingface_hub.errors import LocalTokenNotFoundError, RepositoryNotFoundError

from sb3_bruno.export.shared import check_names, check_sizes

LOG_IN = "log in by `hf auth login`, or set HF_TOKEN"
_OF_THE_HUB = ".gitattributes"  # which the hub itself puts there


def push(folder: Path, names: Sequence[str], repo_id: str, *, private: bool = False) -> str:
    """Send files to a repository, which is made if there is none.

    Args:
        folder: where they are.
        names: their paths in it.
        repo_id: "NAME/REPOSITORY".
        private: whether a new repository is for its owner alone.

    Returns:
        The address of the repository.

    Raises:
        ValueError: if the hub cannot be reached, or refuses.
    """
    if get_token() is None:
        raise ValueError(f"--repo-id {repo_id}: nobody is logged in to the hub: {LOG_IN}")
    with _told(repo_id):
        api = HfApi()
        url = api.create_repo(repo_id, private=private, exist_ok=True)
        api.upload_folder(
            repo_id=repo_id, folder_path=folder, allow_patterns=list(names), commit_message="An agent of sb3_bruno"
        )
    return str(url)


def fetch(repo_id: str, folder: Path) -> str:
    """Fetch an agent's files from a repository.

    Args:
        repo_id: "NAME/REPOSITORY".
        folder: where to put them.

    Returns:
        The name of the environment.

    Raises:
        ValueError: if the hub cannot be reached, there is no such repository, or it holds other files than an agent's,
            or larger ones.
    """
    with _told(repo_id):
        api = HfApi()
        info = api.model_info(repo_id, files_metadata=True)
        sizes = {file.rfilename: file.size for file in info.siblings or [] if file.rfilename != _OF_THE_HUB}
    env = check_names(sizes, f"--repo-id {repo_id}")
    check_sizes(sizes, f"--repo-id {repo_id}")
    with _told(repo_id):
        for name in sizes:
            api.hf_hub_download(repo_id, name, revision=info.sha, local_dir=folder)
        shutil.rmtree(folder / ".cache", ignore_errors=True)  # in which the library keeps notes
    return env


@contextmanager
def _told(repo_id: str) -> Iterator[None]:
    """Tell what goes wrong between here and the hub as a ValueError."""
    try:
        yield
    except RepositoryNotFoundError as error:
        problem = "the hub has no such repository, or does not show it to you"
        raise ValueError(f"--repo-id {repo_id}: {problem}: correct the name, or {LOG_IN}") from error
    except LocalTokenNotFoundError as error:
        raise ValueError(f"--repo-id {repo_id}: nobody is logged in to the hub: {LOG_IN}") from error
    except Exception as error:  # of the network, of its library, or of the hub
        told = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(
            f"--repo-id {repo_id}: the hub refused, or cannot be reached: {told[:300]}: try again"
        ) from error
