"""What methods have to tell when something has changed; who tells it knows the nodes, they need not."""

from typing import Protocol

from library.description import SkillDescription


class Telling(Protocol):
    """Raises the events of what methods have done, and brings the nodes up to date."""

    async def version_changed(self, description: SkillDescription, actor: str, comment: str) -> None:
        """A version was learned, approved, rejected, retired or imported."""
        ...

    async def deployment_changed(
        self, description: SkillDescription, workstation: str, there: bool, actor: str
    ) -> None:
        """A version was deployed or withdrawn."""
        ...

    async def protective_stop(self, workstation: str, reason: str, actor: str) -> None:
        """An arm was stopped."""
        ...
