"""Commands of `hapticd`: one module or package for each; `__main__.COMMANDS` names them."""
