//! Packages, models, functions, types and declarations: text to tree.

use super::lexer::Token;
use super::parser::{Parser, Read};
use super::tree::{
    Attribute, AttributeValue, Declaration, Direction, Function, Model, Modification, Span, Text, TypeDefinition, Variability,
};

/// The advice for a text that is not flat.
const FLATTEN: &str = "flatten the component model first: `omc --baseModelica`, or rumoca's target `base-modelica`";

impl Parser<'_> {
    /// The whole text.
    pub(crate) fn text(&mut self) -> Text {
        let mut text = Text::default();
        while !self.is_end() {
            if self.definition(&mut text).is_err() {
                self.recover();
                self.stray_end();
            }
        }
        text
    }

    /// Skips an `end NAME;` that closes a part that could not be read.
    fn stray_end(&mut self) {
        if self.takes_keyword("end") {
            if matches!(self.token(), Token::Name(_) | Token::Keyword(_)) {
                self.advance();
            }
            self.takes_sign(";");
        } else if matches!(self.token(), Token::Keyword("equation" | "algorithm" | "public" | "protected" | "initial")) {
            self.advance();
        }
    }

    /// A definition inside a package or outside.
    fn definition(&mut self, text: &mut Text) -> Read<()> {
        self.skip_decoration();
        let span = self.span();
        match self.token().clone() {
            Token::Keyword("package") => {
                self.advance();
                let name = self.dotted("the name of the package")?;
                self.comment()?;
                while !self.is_end() && !self.is_keyword("end") {
                    if self.definition(text).is_err() {
                        self.recover();
                        // After a definition that could not be read, its `end` is not the end of the package.
                        let closes_package = matches!(self.ahead(), Token::Name(found) if *found == name);
                        if !(self.is_keyword("end") && closes_package) {
                            self.stray_end();
                        }
                    }
                }
                self.closes_class(&name, &span)
            }
            Token::Keyword("model") => {
                let model = self.model()?;
                text.models.push(model);
                Ok(())
            }
            Token::Keyword("pure" | "impure" | "function") => {
                let function = self.function()?;
                text.functions.push(function);
                Ok(())
            }
            Token::Keyword("type") => {
                let definition = self.type_definition()?;
                text.types.push(definition);
                Ok(())
            }
            Token::Keyword("constant") => {
                let declarations = self.declaration()?;
                self.sign(";", "at the end of a declaration")?;
                text.constants.extend(declarations);
                Ok(())
            }
            Token::Keyword("annotation") => {
                self.skip_annotation()?;
                self.sign(";", "after an annotation")
            }
            Token::Keyword("within") => {
                self.recover();
                Ok(())
            }
            Token::Keyword("record") => {
                let help = "write its members as variables (`omc --baseModelica --baseModelicaFormat=withoutRecords` does so)";
                self.skip_definition("a `record` is not supported", help)
            }
            Token::Keyword("operator") => self.skip_definition(
                "an operator record is not supported",
                "write its members as variables and its operators as equations",
            ),
            Token::Keyword("class" | "block") => {
                let found = self.found();
                self.skip_definition(&format!("{found} is not supported in flat text"), "write `model`")
            }
            Token::Keyword("connector" | "partial" | "encapsulated" | "expandable") => {
                let found = self.found();
                self.skip_definition(&format!("{found} is allowed in component models only, not in flat text"), FLATTEN)
            }
            _ => {
                let result = self.unexpected("`model`, `function`, `type`, `constant` or `package`");
                self.advance();
                result
            }
        }
    }

    /// Reports that a definition is not supported, and continues after it.
    fn skip_definition(&mut self, what: &str, help: &str) -> Read<()> {
        let told = self.fault_with_help::<()>(self.span(), what, help);
        while matches!(self.token(), Token::Keyword(_)) {
            self.advance();
        }
        if let Token::Name(name) = self.token().clone() {
            self.skip_class(&name);
            // The fault is reported, and there is nothing to skip.
            return Ok(());
        }
        told
    }

    fn closes_class(&mut self, name: &str, opened: &Span) -> Read<()> {
        let (line, _) = self.source.position(opened.start);
        if !self.takes_keyword("end") {
            return self.unexpected(&format!("`end {name};`, which closes line {line}"));
        }
        let span = self.span();
        let found = self.dotted(&format!("`{name}` after `end`"))?;
        if found != name {
            return self.fault(span, format!("found `end {found}`, expected `end {name}`, which closes line {line}"));
        }
        // rumoca omits the last semicolon, OpenModelica writes it. Both are accepted at the end of a text.
        if !self.takes_sign(";") && !self.is_end() {
            return self.unexpected(&format!("`;` after `end {name}`"));
        }
        Ok(())
    }

    fn model(&mut self) -> Read<Model> {
        let opened = self.span();
        self.advance();
        let name = self.dotted("the name of the model")?;
        let mut model = Model { name: name.clone(), ..Model::default() };
        model.description = self.comment()?;
        loop {
            match self.token().clone() {
                Token::End | Token::Keyword("end") => break,
                Token::Keyword("equation") => {
                    self.advance();
                    let equations = self.equations();
                    model.equations.extend(equations);
                }
                Token::Keyword("initial") if matches!(self.ahead(), Token::Keyword("equation")) => {
                    self.advance();
                    self.advance();
                    let equations = self.equations();
                    model.initial_equations.extend(equations);
                }
                Token::Keyword("algorithm" | "initial") => {
                    let what = "an `algorithm` of a model is not supported";
                    let _ = self.fault_with_help::<()>(
                        self.span(),
                        what,
                        "write equations, or a function whose algorithm is assignments and `if`",
                    );
                    self.advance();
                    self.takes_keyword("algorithm");
                    self.statements();
                }
                Token::Keyword("external") => {
                    let what = "an external part of a model is not supported";
                    let _ = self.fault_with_help::<()>(self.span(), what, "write its equations");
                    self.recover();
                }
                Token::Keyword("annotation") => {
                    if self.skip_annotation().and_then(|()| self.sign(";", "after an annotation")).is_err() {
                        self.recover();
                    }
                }
                _ => {
                    if self.section_of_declarations(&mut model.declarations).is_err() {
                        self.recover();
                    }
                }
            }
        }
        self.closes_class(&name, &opened)?;
        Ok(model)
    }

    /// One declaration, or a keyword before it that has no effect here.
    fn section_of_declarations(&mut self, declarations: &mut Vec<Declaration>) -> Read<()> {
        if self.takes_keyword("public") || self.takes_keyword("protected") {
            return Ok(());
        }
        declarations.extend(self.declaration()?);
        self.sign(";", "at the end of a declaration")
    }

    fn function(&mut self) -> Read<Function> {
        let opened = self.span();
        while self.takes_keyword("pure") || self.takes_keyword("impure") || self.takes_keyword("constant") {}
        self.keyword("function", "after `pure`")?;
        let span = self.span();
        let name = self.dotted("the name of the function")?;
        if self.is_sign("=") {
            let what = format!("`function {name} = ...` is not supported");
            return self.fault_with_help(
                span,
                what,
                "write the function with its algorithm, or use the function that it replaces",
            );
        }
        self.comment()?;
        let mut function = Function { name: name.clone(), span: span.clone(), declarations: Vec::new(), algorithm: None };
        loop {
            match self.token().clone() {
                Token::End | Token::Keyword("end") => break,
                Token::Keyword("algorithm") => {
                    self.advance();
                    let statements = self.statements();
                    function.algorithm.get_or_insert_default().extend(statements);
                }
                Token::Keyword("external") => {
                    let what = format!("the function `{name}` is external: code of another language is not supported");
                    let _ = self.fault_with_help::<()>(
                        self.span(),
                        what,
                        "write its algorithm, or leave the algorithm out and give a response surface under [functions] of the plant file",
                    );
                    self.recover();
                }
                Token::Keyword("annotation") => {
                    if self.skip_annotation().and_then(|()| self.sign(";", "after an annotation")).is_err() {
                        self.recover();
                    }
                }
                Token::Keyword("equation" | "initial") => {
                    let _ = self.unexpected::<()>("`algorithm`: a function has no equations");
                    self.recover();
                    self.advance();
                    self.equations();
                }
                _ => {
                    if self.section_of_declarations(&mut function.declarations).is_err() {
                        self.recover();
                    }
                }
            }
        }
        self.closes_class(&name, &opened)?;
        Ok(function)
    }

    fn type_definition(&mut self) -> Read<TypeDefinition> {
        self.advance();
        let name = self.dotted("the name of the type")?;
        self.sign("=", "after the name of a type")?;
        if self.is_keyword("enumeration") {
            let what = "an enumeration is not supported";
            return self.fault_with_help(self.span(), what, "write its values as Integer constants");
        }
        let base = self.dotted("a type: Real, Integer or Boolean")?;
        let sizes = if self.is_sign("[") { self.subscripts()? } else { Vec::new() };
        let modification = self.modification()?;
        self.comment()?;
        self.sign(";", "at the end of a type")?;
        Ok(TypeDefinition { name, base, sizes, modification })
    }

    /// A declaration of one or several names.
    fn declaration(&mut self) -> Read<Vec<Declaration>> {
        self.skip_decoration();
        let mut variability = Variability::Continuous;
        let mut direction = Direction::Neither;
        loop {
            match self.token() {
                Token::Keyword("final") => {}
                Token::Keyword("constant") => variability = Variability::Constant,
                Token::Keyword("parameter") => variability = Variability::Parameter,
                Token::Keyword("discrete") => variability = Variability::Discrete,
                Token::Keyword("input") => direction = Direction::Input,
                Token::Keyword("output") => direction = Direction::Output,
                Token::Keyword(
                    "flow" | "stream" | "inner" | "outer" | "replaceable" | "redeclare" | "extends" | "import" | "connector"
                    | "partial",
                ) => {
                    let what = format!("{} is allowed in component models only, not in flat text", self.found());
                    return self.fault_with_help(self.span(), what, FLATTEN);
                }
                Token::Keyword("equation") if variability == Variability::Parameter => {
                    let what = "`parameter equation` is not supported";
                    return self.fault_with_help(self.span(), what, "give the parameter a value: `parameter Real x = ...`");
                }
                Token::Keyword("model" | "function" | "type" | "record" | "class" | "block" | "package") => {
                    let what = format!("found {} inside another definition", self.found());
                    return self.fault_with_help(self.span(), what, "write it before the model, in the package");
                }
                _ => break,
            }
            self.advance();
        }
        let type_span = self.span();
        if let Token::Name(name) = self.token()
            && matches!(name.as_str(), "Clock" | "partition" | "subpartition")
        {
            let what = format!("`{name}`: synchronous clocks are not supported");
            return self.fault_with_help(type_span, what, "write `when sample(start, period) then ... end when;`");
        }
        let type_name = self.dotted("a declaration: a type and a name")?;
        let type_sizes = if self.is_sign("[") { self.subscripts()? } else { Vec::new() };
        let mut declarations = Vec::new();
        loop {
            let span = self.span();
            let name = self.declared_name()?;
            let mut sizes = if self.is_sign("[") { self.subscripts()? } else { Vec::new() };
            sizes.extend(type_sizes.iter().cloned());
            let modification = self.modification()?;
            if self.is_keyword("if") {
                let help = "leave the component out of the text, or write both cases as if-expressions";
                return self.fault_with_help(self.span(), "a conditional component is not supported", help);
            }
            let description = self.comment()?;
            declarations.push(Declaration {
                variability,
                direction,
                type_name: type_name.clone(),
                type_span: type_span.clone(),
                name,
                span,
                sizes,
                modification,
                description,
            });
            if !self.takes_sign(",") {
                return Ok(declarations);
            }
        }
    }

    /// A declared name; rumoca writes `motor.w` without quotes, and subscripts of a component inside (`mass[1].v`).
    fn declared_name(&mut self) -> Read<String> {
        let mut name = self.name("a name after the type")?;
        loop {
            let inner_subscript = self.is_sign("[") && self.subscript_belongs_to_name();
            if self.is_sign(".") && matches!(self.ahead(), Token::Name(_)) {
                self.advance();
                name.push('.');
                name.push_str(&self.name("a name after the point")?);
            } else if inner_subscript {
                let start = self.span().start;
                self.subscripts()?;
                let span = self.since(start);
                name.extend(self.source.text()[span].chars().filter(|symbol| !symbol.is_whitespace()));
            } else {
                return Ok(name);
            }
        }
    }

    /// Whether `[...]` at the present place is followed by `.`: then it is a part of a longer name.
    fn subscript_belongs_to_name(&self) -> bool {
        let text = &self.source.text()[self.span().start..];
        text.find(']').is_some_and(|end| text[end + 1..].trim_start().starts_with('.'))
    }

    /// `(attributes) = value`, or nothing.
    fn modification(&mut self) -> Read<Modification> {
        let mut modification = Modification::default();
        if self.takes_sign("(") {
            while !self.is_sign(")") {
                modification.attributes.push(self.attribute()?);
                if !self.takes_sign(",") {
                    break;
                }
            }
            self.sign(")", "after the attributes of a declaration")?;
        }
        if self.takes_sign("=") || self.takes_sign(":=") {
            modification.value = Some(self.expression()?);
        }
        Ok(modification)
    }

    fn attribute(&mut self) -> Read<Attribute> {
        self.skip_decoration();
        while self.takes_keyword("final") || self.takes_keyword("each") {}
        let span = self.span();
        if self.is_keyword("redeclare") || self.is_keyword("replaceable") {
            let what = format!("{} is allowed in component models only, not in flat text", self.found());
            return self.fault_with_help(span, what, FLATTEN);
        }
        let name = self.dotted("an attribute, such as `unit` or `start`")?;
        let value = if self.is_sign("(") || self.is_sign("[") {
            // Reported with the variable when names are resolved.
            let mut depth = 0_usize;
            loop {
                match self.token() {
                    Token::Sign("(" | "[") => depth += 1,
                    Token::Sign(")" | "]") => depth = depth.saturating_sub(1),
                    Token::End | Token::Sign(";") => return self.unexpected("`)` after an attribute"),
                    _ => {}
                }
                self.advance();
                if depth == 0 {
                    break;
                }
            }
            if self.takes_sign("=") {
                self.expression()?;
            }
            AttributeValue::Nested
        } else {
            self.sign("=", &format!("after the attribute `{name}`"))?;
            match self.token().clone() {
                Token::Text(text) => {
                    self.advance();
                    AttributeValue::Text(text)
                }
                _ => AttributeValue::Expression(self.expression()?),
            }
        };
        self.comment()?;
        Ok(Attribute { name, value, span })
    }
}
