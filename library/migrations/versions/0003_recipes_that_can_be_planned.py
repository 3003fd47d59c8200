"""Recipes keep within what a motion can be planned with; one from before that did not could never be run."""

import json

import sqlalchemy as sql
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

RANGES = {
    "timeStep": (0.001, 0.02),
    "speed": (0.0, 1.0),
    "approachHeight": (0.0, 0.5),
    "retractHeight": (0.0, 0.5),
    "dispenseLead": (-1.0, 1.0),
}


def upgrade() -> None:
    """Bring what lies outside a range to its nearest end."""
    connection = op.get_bind()
    recipes = sql.table("recipes", sql.column("recipe_id", sql.String), sql.column("content", sql.Text))
    for recipe_id, content in connection.execute(sql.select(recipes.c.recipe_id, recipes.c.content)).all():
        recipe = json.loads(content)
        kept = {name: min(max(recipe[name], low), high) for name, (low, high) in RANGES.items() if name in recipe}
        if any(recipe[name] != value for name, value in kept.items()):
            changed = json.dumps({**recipe, **kept})
            connection.execute(recipes.update().where(recipes.c.recipe_id == recipe_id).values(content=changed))
