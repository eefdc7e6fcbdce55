"""How often something rare happens: importance sampling on what makes an encounter."""
